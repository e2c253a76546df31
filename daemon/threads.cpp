#include "daemon/threads.hpp"

#include <spdlog/spdlog.h>

namespace isorig::daemon {
namespace {

constexpr auto kComplaintPeriod = std::chrono::seconds(10);

}  // namespace

void Complaint::note(const char* what) noexcept {
  const auto now = std::chrono::steady_clock::now();
  if (now < next_) return;
  next_ = now + kComplaintPeriod;
  try {
    spdlog::error("{}: {}", name_, what);
  } catch (...) {  // no memory for a line: the thread goes on all the same
  }
}

}  // namespace isorig::daemon
