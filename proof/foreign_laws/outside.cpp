#include <numbers>

#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {

Signal eccentric_position(const Signal& position_mm, double eccentricity_mm, double pitch_mm) {
  Signal grip = position_mm;
  const double start = std::sin(2.0 * std::numbers::pi * position_mm.front() / pitch_mm);
  for (double& x : grip) x += eccentricity_mm * (std::sin(2.0 * std::numbers::pi * x / pitch_mm) - start);
  return grip;
}

double cogging_N(double force_N, double position_mm, double pitch_mm) {
  const double angle = 2.0 * std::numbers::pi * position_mm / pitch_mm;
  return force_N * (std::sin(angle) + 0.3 * std::sin(3.0 * angle));
}

double von_mises_truss_N(double stiffness_N_mm, double apex_mm, double rise_mm) {
  // Bars at 45 degrees: half span and rise are equal, and l0^2 = 2 rise^2.
  return stiffness_N_mm * apex_mm * (1.0 - std::numbers::sqrt2 * rise_mm / std::hypot(rise_mm, apex_mm));
}

Signal snapping_truss(const Drive& drive, double stiffness_N_mm, double at_mm, double rise_mm) {
  constexpr double kTime_s = 0.01;
  const double series_N_mm = stiffness_N_mm / 3.0;
  const double viscosity = stiffness_N_mm * kTime_s;
  Signal force(drive.size());
  integrate<1>(
      drive, {-rise_mm},
      [&](const std::array<double, 1>& apex, std::size_t i, double part) {
        const double end_mm = within(drive.position_mm, i, part) - at_mm - rise_mm;
        return std::array{(series_N_mm * (end_mm - apex[0]) - von_mises_truss_N(stiffness_N_mm, apex[0], rise_mm)) /
                          viscosity};
      },
      [&](std::size_t i, const std::array<double, 1>& apex) {
        force[i] = series_N_mm * (drive.position_mm[i] - at_mm - rise_mm - apex[0]);
      });
  return force;
}

Signal permanent_set(const Drive& drive, double share, double yield_mm) {
  Signal force(drive.size());
  double set_mm = 0.0;
  for (std::size_t i = 0; i < force.size(); ++i) {
    set_mm = std::max(set_mm, share * (drive.position_mm[i] - yield_mm));
    force[i] = -drive.stiffness_N_mm * set_mm;
  }
  return force;
}

Signal one_way_damping(const Drive& drive, double damping_N_s_mm) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < force.size(); ++i) force[i] = damping_N_s_mm * std::max(0.0, drive.velocity_mm_s[i]);
  return force;
}

Signal bladder_contact(const Drive& drive, double stiffness_N_mm, double at_mm, double damping_s_mm) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < force.size(); ++i) {
    const double depth_mm = at_mm - drive.position_mm[i];  // the bladder touches as the muscle shortens and widens
    if (depth_mm <= 0.0) continue;
    const double damped = std::max(0.0, 1.0 - damping_s_mm * drive.velocity_mm_s[i]);
    force[i] = -stiffness_N_mm * depth_mm * std::sqrt(depth_mm) * damped;
  }
  return force;
}

Signal self_heating(const Drive& drive, double share, double travel_mm, double time_s) {
  Signal force(drive.size());
  integrate<1>(
      drive, {0.0},
      [&](const std::array<double, 1>& heat, std::size_t i, double part) {
        return std::array{std::abs(drive.velocity_within(i, part)) / travel_mm - heat[0] / time_s};
      },
      [&](std::size_t i, const std::array<double, 1>& heat) { force[i] = -share * heat[0] * drive.specimen_N[i]; });
  return force;
}

}  // namespace isorig::proof::foreign
