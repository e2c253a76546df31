#pragma once
#include <cmath>
#include <cstdint>

namespace isorig::clock {

/// Extends a device's 32-bit microsecond counter, which wraps every 71.6 min, to 64 bit.
/// Stamps may come slightly out of order. A restarted device looks like a wrap: DeviceClockMap notices it.
class WrapExtender {
 public:
  /// Good while consecutive stamps are less than half a wrap (35.8 min) apart.
  [[nodiscard]] std::int64_t extend(std::uint32_t raw_us) noexcept {
    if (!started_) {
      started_ = true;
      last_us_ = raw_us;
    } else {
      // The signed difference modulo 2^32 is the step, forwards or slightly back.
      last_us_ += static_cast<std::int32_t>(raw_us - static_cast<std::uint32_t>(last_us_));
    }
    return last_us_;
  }

  /// The same after any silence: the host's clock counts the whole wraps missed. Good while the two clocks
  /// drift apart by less than half a wrap, that is for years.
  [[nodiscard]] std::int64_t extend(std::uint32_t raw_us, std::int64_t host_ns) noexcept {
    const bool first = !started_;
    const std::int64_t before_us = last_us_;
    std::int64_t now_us = extend(raw_us);
    if (!first) {
      const double missed_us =
          static_cast<double>(host_ns - last_host_ns_) * 1e-3 - static_cast<double>(now_us - before_us);
      now_us += static_cast<std::int64_t>(std::llround(missed_us / kWrap_us)) * static_cast<std::int64_t>(kWrap_us);
      last_us_ = now_us;
    }
    last_host_ns_ = host_ns;
    return now_us;
  }

  void restart() noexcept { *this = WrapExtender{}; }

 private:
  static constexpr double kWrap_us = 4294967296.0;
  std::int64_t last_us_ = 0;
  std::int64_t last_host_ns_ = 0;
  bool started_ = false;
};

}  // namespace isorig::clock
