#pragma once
#include <algorithm>
#include <cmath>

#include "model/process.hpp"
#include "model/slse.hpp"

/// Steps shared by elements and effects.
namespace isorig::model {

/// Elongation z of the spring of a Maxwell arm, dz/dt = v - z / tau (paper, eq. for the strain of the series
/// spring; relaxed at the start). Exact at constant velocity.
class MaxwellState {
 public:
  explicit MaxwellState(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(double z_mm = 0.0) noexcept { z_mm_ = z_mm; }
  double step(double step_mm, double dt_s) noexcept {
    if (dt_s <= 0.0) return z_mm_ += step_mm;
    const Relaxation step = relaxation(dt_s / tau_s_);
    z_mm_ = z_mm_ * step.decay + step_mm * step.gain;
    return z_mm_;
  }

 private:
  double tau_s_;
  double z_mm_ = 0.0;
};

/// First-order lag y of an input u, tau dy/dt = u - y, over a step in which the input runs straight: exact.
class StraightLag {
 public:
  /// `dt_s` > 0.
  StraightLag(double dt_s, double time_constant_s) noexcept
      : decay_(-std::expm1(-dt_s / time_constant_s)), fresh_(1.0 - decay_ / (dt_s / time_constant_s)) {}
  /// The output at the step's end, from the output and the input at its begin and the input at its end.
  [[nodiscard]] double next(double output, double input_before, double input) const noexcept {
    return output + (decay_ * (input_before - output) + fresh_ * (input - input_before));
  }

 private:
  double decay_;
  double fresh_;  // weight of the newest input under a straight line
};

inline double sign_of(double value) noexcept {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

}  // namespace isorig::model
