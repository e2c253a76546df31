#pragma once
#include <algorithm>
#include <cstdint>

namespace isorig::drivers {

/// When to try a lost device again: at once, then after `initial_ns`, doubling up to `max_ns`. Deterministic:
/// one host talks to each device, so there is no crowd for random jitter to spread out.
///
///     if (backoff.is_due(now_ns)) {
///       try { device.connect(); backoff.reset(); } catch (const DeviceError&) { backoff.failed(now_ns); }
///     }
class Backoff {
 public:
  struct Options {
    std::int64_t initial_ns = 50'000'000;  ///< a replugged Teensy enumerates in about 0.3 s
    std::int64_t max_ns = 2'000'000'000;   ///< a person at the rig should not wait longer for the next try
    double factor = 2.0;
  };

  Backoff() noexcept = default;
  explicit Backoff(const Options& options) noexcept : options_(options) {}

  [[nodiscard]] bool is_due(std::int64_t now_ns) const noexcept { return now_ns >= next_ns_; }
  /// When the next try is due; 0 at first and after reset().
  [[nodiscard]] std::int64_t next_ns() const noexcept { return next_ns_; }
  [[nodiscard]] std::uint32_t failures() const noexcept { return failures_; }

  /// Counts a try that failed at `now_ns` and returns the delay to the next one.
  std::int64_t failed(std::int64_t now_ns) noexcept {
    delay_ns_ = failures_ == 0 ? std::min(options_.initial_ns, options_.max_ns) : grown();
    ++failures_;
    next_ns_ = now_ns + delay_ns_;
    return delay_ns_;
  }

  /// After a success.
  void reset() noexcept {
    failures_ = 0;
    next_ns_ = 0;
  }

 private:
  [[nodiscard]] std::int64_t grown() const noexcept {
    const double delay_ns = static_cast<double>(delay_ns_) * options_.factor;
    return delay_ns >= static_cast<double>(options_.max_ns) ? options_.max_ns : static_cast<std::int64_t>(delay_ns);
  }

  Options options_{};
  std::int64_t delay_ns_ = 0;
  std::int64_t next_ns_ = 0;
  std::uint32_t failures_ = 0;
};

}  // namespace isorig::drivers
