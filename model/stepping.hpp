#pragma once
#include <algorithm>
#include <cmath>

#include "model/process.hpp"

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
    const double x = dt_s / tau_s_;
    const double decay = -std::expm1(-x);  // 1 - exp(-x), exact for short steps too
    z_mm_ += decay * (step_mm / x - z_mm_);
    return z_mm_;
  }

 private:
  double tau_s_;
  double z_mm_ = 0.0;
};

inline double sign_of(double value) noexcept {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

}  // namespace isorig::model
