#pragma once
#include <cstdint>

namespace isorig::sim {

/// When the simulated sync line changes, in true time: the Teensy raises it, the host's GPIO sees it. Each side keeps
/// its own place.
class SyncLineTimes {
 public:
  static constexpr std::int64_t kPeriod_ns = 500'000'000;

  explicit SyncLineTimes(std::int64_t start_ns) noexcept : next_ns_((start_ns / kPeriod_ns + 1) * kPeriod_ns) {}

  /// The next edge that has come by `now_ns`; false when none has. A side that was away for longer than it can tell
  /// the time back has missed what was in between.
  bool next(std::int64_t now_ns, std::int64_t& edge_ns, bool& rising) noexcept {
    if (now_ns - next_ns_ > kMemory_ns) next_ns_ = (now_ns / kPeriod_ns + 1) * kPeriod_ns;
    if (now_ns < next_ns_) return false;
    edge_ns = next_ns_;
    rising = next_ns_ / kPeriod_ns % 2 == 1;
    next_ns_ += kPeriod_ns;
    return true;
  }

 private:
  static constexpr std::int64_t kMemory_ns = 10'000'000;  // within which a DeviceClock is exact
  std::int64_t next_ns_;
};

}  // namespace isorig::sim
