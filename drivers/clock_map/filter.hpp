#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "drivers/clock_map/envelope.hpp"
#include "drivers/clock_map/wander.hpp"

namespace isorig::clock {

/// Mean and covariance of (host - device in us, its slope in ppm, the base delay in us) at one device time.
struct FilterState {
  double device_s = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// Moves a state to another device time, forwards or (diffusing as much) backwards.
[[nodiscard]] FilterState predicted(FilterState state, double device_s, const Wander& wander) noexcept;

/// Best estimate of a wandering clock from two-way exchanges.
///
/// Law. Delays are base + exponential tail, the base alike both ways, so an exchange says
///   high = h + base + e1, low = h - base - e2,  p(e) = exp(-e / tail) / tail for e >= 0, else 0,
/// of the difference h. One side's likelihood in z = h + base is exp(z / tail) below `high` and zero above:
/// it leaves a Gaussian, shifted and cut off, and mean and variance of that are exact (assumed density
/// filtering: Maybeck 1982; Minka 2001). Between exchanges h and its slope diffuse as a Kalman filter's
/// (Wander). So an exchange near the minimum delay pins the clock from its side, a slow one only says that it
/// is slow, with the same weight however slow, and the estimate knows its own standard deviation. Valid:
/// tails of any one scale per direction (learnt, spikes clipped at five scales). Error: half the difference
/// of the base delays cannot be seen and is in the mean, not in the deviation.
class DelayFilter {
 public:
  explicit DelayFilter(const Wander& wander) : wander_(wander) {}

  /// Times absolute, from any fixed origin, in order. The first 50 are kept and gone through again each time.
  void add(const Interval& exchange) noexcept;
  [[nodiscard]] const FilterState& state() const noexcept { return state_; }
  [[nodiscard]] bool started() const noexcept { return count_ > 0; }

 private:
  static constexpr std::size_t kSettling = 50;
  void settle() noexcept;
  void begin(const Interval& around, double device_s, double sd_us, double base_us) noexcept;
  void observe(const Interval& exchange, double tail_share) noexcept;

  Wander wander_;
  FilterState state_;
  double tail_high_us_ = 0.0;
  double tail_low_us_ = 0.0;
  std::size_t count_ = 0;
  std::array<Interval, kSettling> first_{};
};

}  // namespace isorig::clock
