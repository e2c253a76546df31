#include "daemon/recording/recorder_types.hpp"

#include <algorithm>
#include <stdexcept>

namespace isorig::daemon {

const char* describe(DiskCondition condition) noexcept {
  switch (condition) {
    case DiskCondition::kOk:
      return "ok";
    case DiskCondition::kLow:
      return "free space below the limit; nothing lost: free some, then reset";
    case DiskCondition::kReserve:
      return "disk full, writing into the reserve; nothing lost: free some, then reset";
    case DiskCondition::kFailing:
      return "the disk takes nothing, holding in memory; nothing lost yet";
    case DiskCondition::kUnvouched:
      return "the disk failed to keep what it had taken: the run cannot be called whole; look at the disk (dmesg)";
    case DiskCondition::kLost:
      return "the disk takes nothing and the memory for it is used up: messages were lost";
  }
  return "";
}

std::uint64_t estimate_bytes(double full_s, double averaged_s, double average_interval_s) noexcept {
  // Measured (build/bin/bench_recorder_drain): both streams, control and exchanges, a little more for events.
  constexpr double kFullBytesPerS = 92'000.0;
  constexpr double kBytesPerInterval = 330.0;
  return static_cast<std::uint64_t>(full_s * kFullBytesPerS + averaged_s / average_interval_s * kBytesPerInterval);
}

std::int32_t session_of(const RunInfo& info, std::uint32_t step, std::int32_t present) {
  if (info.sessions.empty()) return 0;
  if (step == kNoStep) return std::max(present, info.first_session);
  const auto after = std::upper_bound(info.sessions.begin(), info.sessions.end(), step,
                                      [](std::uint32_t s, const SessionInfo& i) { return s < i.first_step; });
  return std::max(static_cast<std::int32_t>(after - info.sessions.begin()) - 1, info.first_session);
}

const RecorderOptions& checked(const RecorderOptions& o) {
  if (!(o.average_interval_s >= 0.001) || !(o.before_s >= 0.0) || !(o.sync_interval_s > 0.0) || !(o.lag_s >= 0.0) ||
      !(o.max_rate_hz > 0.0)) {
    throw std::invalid_argument(
        "recorder: needs average_interval_s >= 0.001, before_s >= 0, sync_interval_s > 0, lag_s >= 0 and "
        "max_rate_hz > 0");
  }
  return o;
}

}  // namespace isorig::daemon
