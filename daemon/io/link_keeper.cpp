#include "daemon/io/link_keeper.hpp"

#include "daemon/core/fixed_text.hpp"

namespace isorig::daemon {
namespace {

// Fewer leave the first stamps with a scatter of a whole round trip.
constexpr std::uint64_t kExchangesForReady = 20;

// A refusal leaves the connection good. A missing or spoilt answer is cleared up by the driver, which lets no late
// reply through; only when they repeat is the connection started afresh, since that stops the frame.
bool loses_connection(drivers::Fault fault, int failures_in_a_row) {
  switch (fault) {
    case drivers::Fault::kRefused:
      return false;
    case drivers::Fault::kTimeout:
    case drivers::Fault::kProtocol:
      return failures_in_a_row >= 5;
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

void LinkKeeper::note_connected(const std::string& identity, double sample_rate_hz) noexcept {
  copy_text(health_.identity, identity);
  health_.sample_rate_hz = static_cast<float>(sample_rate_hz);
  health_.connected = true;
  if (was_connected_) ++health_.reconnects;
  was_connected_ = true;
  backoff_.reset();
  failures_in_a_row_ = 0;
  burst_left_ = config_.sync_burst;
  mapper_.set_period_us(sample_rate_hz > 0.0 ? 1e6 / sample_rate_hz : 0.0);
}

bool LinkKeeper::note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  ++health_.errors;
  health_.failed_ns = now_ns;
  copy_text(health_.detail, error.what());
  // A connect() that fails has to wait for the next try, whatever the reason.
  if (health_.connected && !loses_connection(error.fault(), ++failures_in_a_row_)) return false;
  health_.connected = false;
  failures_in_a_row_ = 0;
  backoff_.failed(now_ns);
  return true;
}

void LinkKeeper::report_health(std::int64_t now_ns, base::SpscQueue<LinkHealth>& to, bool force) noexcept {
  if (!force && now_ns < next_health_ns_) return;
  next_health_ns_ = now_ns + kHealthPeriodNs;
  health_.clock_epoch = static_cast<std::uint32_t>(map_.current().epoch);
  health_.clock_rejected = static_cast<std::uint32_t>(map_.rejected());
  health_.clock_ready = map_.current().known() && map_.current().exchanges >= kExchangesForReady;
  to.push(health_);
}

}  // namespace isorig::daemon
