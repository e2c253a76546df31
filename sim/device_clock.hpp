#pragma once
#include <cmath>
#include <cstdint>

#include "sim/config.hpp"
#include "sim/random.hpp"

namespace isorig::sim {

/// A device's free-running clock: continuous, its rate constant over pieces of 1 s, the rate error skew plus
/// a Gauss-Markov process stepped exactly. Device time is in fractional microseconds, host time in ns.
class DeviceClock {
 public:
  static constexpr std::int64_t kPiece_ns = 1'000'000'000;

  DeviceClock(const DeviceClockParameters& parameters, Random random, std::int64_t start_ns) noexcept
      : random_(random),
        skew_(parameters.skew_ppm * 1e-6),
        wander_rms_(parameters.wander_ppm * 1e-6),
        decay_(std::exp(-1e-9 * static_cast<double>(kPiece_ns) / parameters.wander_time_s)),
        host_ns_(start_ns),
        device_us_(parameters.offset_us) {
    wander_ = wander_rms_ * random_.normal();
    rate_ = 1.0 + skew_ + wander_;
  }

  /// Makes the piece that holds `host_ns` the current one; never goes back.
  void advance_to(std::int64_t host_ns) noexcept {
    while (host_ns - host_ns_ >= kPiece_ns) {
      device_us_ += 1e-3 * static_cast<double>(kPiece_ns) * rate_;
      host_ns_ += kPiece_ns;
      wander_ = wander_ * decay_ + wander_rms_ * std::sqrt(1.0 - decay_ * decay_) * random_.normal();
      rate_ = 1.0 + skew_ + wander_;
    }
  }
  /// Exact within the current piece; within 1 ns up to 10 ms outside it.
  [[nodiscard]] double device_us(double host_ns) const noexcept {
    return device_us_ + 1e-3 * (host_ns - static_cast<double>(host_ns_)) * rate_;
  }
  /// Host time relative to `origin_ns`, which keeps sub-nanosecond precision on long runs.
  [[nodiscard]] double host_since(std::int64_t origin_ns, double device_us) const noexcept {
    return static_cast<double>(host_ns_ - origin_ns) + 1e3 * (device_us - device_us_) / rate_;
  }
  /// host_since() is later than `length_ns`, told by products alone where it is by far: what a sampler asks each step
  /// of a sample that is not due yet. False: host_since() has to tell.
  [[nodiscard]] bool is_far_after(std::int64_t origin_ns, double length_ns, double device_us) const noexcept {
    constexpr double kFar_ns = 1e3;
    const double left_ns = length_ns + kFar_ns - static_cast<double>(host_ns_ - origin_ns);
    return 1e3 * (device_us - device_us_) > left_ns * rate_;
  }
  /// It is set: shows so much more from now on.
  void jump(double by_us) noexcept { device_us_ += by_us; }
  [[nodiscard]] double rate() const noexcept { return rate_; }

 private:
  Random random_;
  double skew_, wander_rms_, decay_;
  double wander_ = 0.0;
  double rate_ = 1.0;
  std::int64_t host_ns_;
  double device_us_;
};

/// Draws one-way delays.
class Delay {
 public:
  Delay(const DelayParameters& parameters, Random random) noexcept : p_(parameters), random_(random) {}
  [[nodiscard]] double next_ns() noexcept {
    double ms = p_.base_ms + p_.tail_ms * random_.exponential();
    if (random_.uniform() < p_.spike_probability) ms += p_.spike_ms;
    return ms * 1e6;
  }
  [[nodiscard]] double base_ns() const noexcept { return p_.base_ms * 1e6; }

 private:
  DelayParameters p_;
  Random random_;
};

}  // namespace isorig::sim
