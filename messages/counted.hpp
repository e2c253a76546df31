#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace isorig::messages {

/// No clock and no counter of ours comes here: as nanoseconds 73 years, as microseconds 73,000. The difference of two
/// such numbers, and the sum of either with an offset, cannot overflow.
inline constexpr std::int64_t kMostCounted = std::int64_t{1} << 61U;

inline constexpr std::int32_t kMostAttempts = std::int32_t{1} << 30U;

[[nodiscard]] constexpr bool is_counted(std::int64_t value) noexcept {
  return value > -kMostCounted && value < kMostCounted;
}
[[nodiscard]] inline bool is_counted(const std::vector<std::int64_t>& values) noexcept {
  for (const auto value : values)
    if (!is_counted(value)) return false;
  return true;
}

/// Whether the times and counters of a message are such as clocks and counters have. Of a message that was damaged, or
/// made up, they may be anything, and everybody who reads a recording calculates with them.
template <typename Message>
[[nodiscard]] bool is_counted_message(const Message& m) noexcept {
  bool good = true;
  if constexpr (requires { m.attempt; }) good = good && m.attempt >= 0 && m.attempt < kMostAttempts;
  if constexpr (requires { m.number; }) good = good && is_counted(m.number);
  if constexpr (requires { m.mono_ns; }) good = good && is_counted(m.mono_ns);
  if constexpr (requires { m.sequence; }) good = good && is_counted(m.sequence) && is_counted(m.device_us);
  if constexpr (requires { m.epoch_unix_us; }) good = good && is_counted(m.epoch_unix_us);
  if constexpr (requires { m.host_send_ns; }) good = good && is_counted(m.host_send_ns) && is_counted(m.host_recv_ns);
  if constexpr (requires { m.first_mono_ns; }) {
    good = good && is_counted(m.first_mono_ns) && is_counted(m.last_mono_ns) && is_counted(m.first_device_us) &&
           is_counted(m.last_device_us) && is_counted(m.first_sequence) && is_counted(m.last_sequence);
    for (const auto samples : m.samples) good = good && samples >= 0;
  }
  if constexpr (requires { m.current; }) {
    for (std::size_t i = 0; i < m.current.size(); ++i) good = good && m.current[i] >= 0 && m.current[i] <= m.samples[i];
  }
  if constexpr (requires { m.dropped_records; }) good = good && is_counted(m.dropped_records);
  if constexpr (requires { m.lost_messages; })
    good = good && is_counted(m.lost_messages) && is_counted(m.events) && is_counted(m.bytes) && is_counted(m.messages);
  if constexpr (requires { m.frame_missing; })
    good = good && is_counted(m.frame_missing) && is_counted(m.pressure_missing);
  if constexpr (requires { m.samples[0].mono_ns; }) {
    for (const auto& each : m.samples) good = good && is_counted(each.mono_ns);
  }
  return good;
}

}  // namespace isorig::messages
