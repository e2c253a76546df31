#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {

double fung_square_N(double stiffness_N_mm, double position_mm, double length_mm) {
  const double strain = position_mm / length_mm;
  return stiffness_N_mm * position_mm * std::expm1(strain * strain);
}

double gent_N(double stiffness_N_mm, double position_mm, double length_mm, double limit) {
  const double s = 1.0 + position_mm / length_mm;
  const double invariant = s * s + 2.0 / s - 3.0;
  // d/ds of (s - 1/s^2) at s = 1 is 3: the slope at rest is the stiffness, and is taken off.
  return stiffness_N_mm * (length_mm / 3.0 * (s - 1.0 / (s * s)) * limit / (limit - invariant) - position_mm);
}

double ogden_N(double stiffness_N_mm, double position_mm, double length_mm, double exponent) {
  const double s = 1.0 + position_mm / length_mm;
  const double force_mm =
      2.0 * length_mm / (3.0 * exponent) * (std::pow(s, exponent - 1.0) - std::pow(s, -0.5 * exponent - 1.0));
  return stiffness_N_mm * (force_mm - position_mm);
}

double hyperbolic_knee_N(double stiffness_N_mm, double position_mm, double at_mm, double width_mm) {
  const double beyond_mm = position_mm - at_mm;
  return stiffness_N_mm * 0.5 * (beyond_mm + std::hypot(beyond_mm, width_mm));
}

double braid_lock_N(double stiffness_N_mm, double position_mm, double lock_mm) {
  return stiffness_N_mm * position_mm * position_mm / (lock_mm - position_mm);
}

}  // namespace isorig::proof::foreign
