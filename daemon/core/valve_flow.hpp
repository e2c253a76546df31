#pragma once
#include <algorithm>
#include <cmath>

/// What the valves give, by ISO 6358 (the formulas of daemon/core/pressure_loop.hpp): shared by the loop, which divides
/// by it, and by the guard, which compares the reading with it. Pressures in psi; gauge unless a name says absolute.
namespace isorig::daemon {

inline constexpr double kAtmospherePsi = 14.696;

[[nodiscard]] inline double flow_factor(double downstream_over_upstream) noexcept {
  constexpr double kCriticalRatio = 0.3;  // b of ISO 6358, typical of small solenoid valves
  const double r = std::clamp(downstream_over_upstream, 0.0, 1.0);
  if (r <= kCriticalRatio) return 1.0;
  const double x = (r - kCriticalRatio) / (1.0 - kCriticalRatio);
  return std::sqrt(std::max(0.0, 1.0 - x * x));
}

/// The chamber's absolute pressure; a reading far below the atmosphere is no pressure.
[[nodiscard]] inline double chamber_absolute_psi(double pressure_psi) noexcept {
  return std::max(pressure_psi + kAtmospherePsi, 1.0);
}

/// Rate of the chamber with the fill valve fully open [psi/s].
[[nodiscard]] inline double fill_rate_psi_s(double fill_gain_per_s, double supply_psi, double pressure_psi) noexcept {
  const double supply_abs = supply_psi + kAtmospherePsi;
  return fill_gain_per_s * supply_abs * flow_factor(chamber_absolute_psi(pressure_psi) / supply_abs);
}

/// The same for the vent valve, as a positive number: the chamber falls at this rate.
[[nodiscard]] inline double vent_rate_psi_s(double vent_gain_per_s, double pressure_psi) noexcept {
  const double chamber_abs = chamber_absolute_psi(pressure_psi);
  return vent_gain_per_s * chamber_abs * flow_factor(kAtmospherePsi / chamber_abs);
}

/// How long the valve has to be fully open from 0 to `to_psi` [s]; what it does not reach costs the last step's time.
[[nodiscard]] inline double fill_time_s(double fill_gain_per_s, double supply_psi, double to_psi) noexcept {
  constexpr int kSteps = 64;
  const double step_psi = std::max(0.0, to_psi) / kSteps;
  double time_s = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double rate = fill_rate_psi_s(fill_gain_per_s, supply_psi, (i + 0.5) * step_psi);
    time_s += step_psi / std::max(rate, 0.02 * fill_gain_per_s * (supply_psi + kAtmospherePsi));
  }
  return time_s;
}

}  // namespace isorig::daemon
