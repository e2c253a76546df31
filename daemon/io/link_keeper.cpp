#include "daemon/io/link_keeper.hpp"

#include "daemon/core/fixed_text.hpp"

namespace isorig::daemon {
namespace {

// A refusal leaves the connection good. A missing or spoilt answer is cleared up by the driver, which lets no late
// reply through; only when they repeat is the connection started afresh, since that stops the frame.
bool loses_connection(drivers::Fault fault, bool repeated) {
  switch (fault) {
    case drivers::Fault::kRefused:
      return false;
    case drivers::Fault::kTimeout:
    case drivers::Fault::kProtocol:
      return repeated;
    case drivers::Fault::kDisconnected:
    case drivers::Fault::kIdentity:
      break;
  }
  return true;
}

}  // namespace

std::string LinkKeeper::words(std::initializer_list<std::string> parts) {
  std::string all;
  for (const auto& part : parts) {
    if (!part.empty()) all += (all.empty() ? "" : ", ") + part;
  }
  return all;
}

void LinkKeeper::fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  if (note_failure(now_ns, error)) drop(now_ns);
  report_health(now_ns, true);
}

void LinkKeeper::note_connected(const std::string& identity) noexcept {
  copy_text(health_.identity, identity);
  health_.connected = true;
  if (was_connected_) ++health_.reconnects;
  was_connected_ = true;
  backoff_.reset();
  failures_in_a_row_ = 0;
}

bool LinkKeeper::note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  ++health_.errors;
  health_.failed_ns = now_ns;
  copy_text(health_.detail, error.what());
  // A connect() that fails has to wait for the next try, whatever the reason.
  if (health_.connected && failures_to_lose_ > 0 &&
      !loses_connection(error.fault(), ++failures_in_a_row_ >= failures_to_lose_)) {
    return false;
  }
  health_.connected = false;
  failures_in_a_row_ = 0;
  backoff_.failed(now_ns);
  return true;
}

void LinkKeeper::report_health(std::int64_t now_ns, bool force) noexcept {
  constexpr std::int64_t kPeriodNs = 100'000'000;
  if (!force && now_ns < next_health_ns_) return;
  next_health_ns_ = now_ns + kPeriodNs;
  complete(health_);
  reports_.push(health_);
}

}  // namespace isorig::daemon
