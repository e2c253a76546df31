#include "proof/foreign_laws/laws.hpp"
#include "proof/generator/random.hpp"

namespace isorig::proof::foreign {

Signal logarithmic_creep(const Signal& t_s, double time_s, double whole_s) {
  Signal drift;
  const double whole = std::log1p(whole_s / time_s);
  for (const double t : t_s) drift.push_back(std::log1p((t - t_s.front()) / time_s) / whole);
  return drift;
}

Signal diffusing_heat(const Signal& t_s, double whole_s) {
  Signal drift;
  for (const double t : t_s) drift.push_back(std::sqrt((t - t_s.front()) / whole_s));
  return drift;
}

Signal thermostat(const Signal& t_s, double room_s, double amplifier_s) {
  Signal drift(t_s.size(), 0.0);
  // Exact for each first-order stage while the heater stays as it is and the room is straight between nodes.
  double room = 0.0, amplifier = 0.0;
  bool heating = true;
  for (std::size_t i = 1; i < t_s.size(); ++i) {
    const double h = t_s[i] - t_s[i - 1];
    const double before = room;
    room += ((heating ? 1.5 : -0.5) - room) * -std::expm1(-h / room_s);
    amplifier += (0.5 * (before + room) - amplifier) * -std::expm1(-h / amplifier_s);
    if (room >= 1.0) heating = false;
    if (room <= 0.0) heating = true;
    drift[i] = amplifier;
  }
  return drift;
}

Signal random_walk(const Signal& t_s, std::uint64_t seed, double whole_s) {
  constexpr double kKnot_s = 2.0;
  const double lasts_s = t_s.back() - t_s.front();
  Random random(seed, "random walk over " + std::to_string(lasts_s) + " s");
  const double step = std::sqrt(kKnot_s / whole_s);
  std::vector<double> knots{0.0};
  while (static_cast<double>(knots.size()) < lasts_s / kKnot_s + 2.0)
    knots.push_back(knots.back() + step * random.normal());
  Signal drift;
  for (const double t : t_s) {
    const double at = (t - t_s.front()) / kKnot_s;
    const auto knot = static_cast<std::size_t>(at);
    drift.push_back(knots[knot] + (at - static_cast<double>(knot)) * (knots[knot + 1] - knots[knot]));
  }
  return drift;
}

Signal trapped_gas(const Drive& drive, double gauge_psi, double share, double stroke_mm, double heat_s) {
  constexpr double kAtmosphere_psi = 14.696, kGamma = 1.4;
  const double filled_psi = gauge_psi + kAtmosphere_psi;
  const auto volume = [&](double x_mm) { return 1.0 - share * (x_mm - drive.position_mm.front()) / stroke_mm; };
  Signal pressure(drive.size());
  integrate<1>(
      drive, {filled_psi},
      [&](const std::array<double, 1>& p, std::size_t i, double part) {
        const double v = volume(within(drive.position_mm, i, part));
        const double growth = -share * drive.velocity_within(i, part) / stroke_mm / v;
        return std::array{-kGamma * p[0] * growth - (p[0] - filled_psi / v) / heat_s};
      },
      [&](std::size_t i, const std::array<double, 1>& p) { pressure[i] = p[0] - kAtmosphere_psi; });
  return pressure;
}

Signal hunting(const Signal& t_s, double amplitude_psi, double period_s, double rise_share) {
  Signal swing;
  for (const double t : t_s) {
    const double phase = t / period_s - std::floor(t / period_s);
    const double up = phase < rise_share ? phase / rise_share : (1.0 - phase) / (1.0 - rise_share);
    swing.push_back(amplitude_psi * (2.0 * up - 1.0));
  }
  return swing;
}

Signal leak_and_refill(const Signal& t_s, double gauge_psi, double leak_s, double depth_psi) {
  constexpr double kFilling_s = 0.4;
  Signal lost(t_s.size(), 0.0);
  double psi = 0.0;
  bool filling = false;
  for (std::size_t i = 1; i < t_s.size(); ++i) {
    const double h = t_s[i] - t_s[i - 1];
    psi += filling ? -psi * -std::expm1(-h / kFilling_s) : -(gauge_psi + psi) * -std::expm1(-h / leak_s);
    if (psi < -depth_psi) filling = true;
    if (psi > -0.05 * depth_psi) filling = false;
    lost[i] = psi;
  }
  return lost;
}

Signal regulator_droop(const Drive& drive, double droop_psi_mm, double recovery_s) {
  Signal pressure(drive.size());
  integrate<1>(
      drive, {0.0},
      [&](const std::array<double, 1>& p, std::size_t i, double part) {
        return std::array{droop_psi_mm * drive.velocity_within(i, part) - p[0] / recovery_s};
      },
      [&](std::size_t i, const std::array<double, 1>& p) { pressure[i] = p[0]; });
  return pressure;
}

Signal braid_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double length_mm,
                        double thread_mm) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < force.size(); ++i) {
    const double share = (length_mm + drive.position_mm[i]) / thread_mm;
    force[i] = force_N_psi * (drive.pressure_psi[i] - nominal_psi) * 0.5 * (3.0 * share * share - 1.0);
  }
  return force;
}

Signal power_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double exponent) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < force.size(); ++i)
    force[i] = force_N_psi * nominal_psi / exponent * (std::pow(drive.pressure_psi[i] / nominal_psi, exponent) - 1.0);
  return force;
}

Signal tube_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double time_s) {
  Signal force(drive.size());
  const double start_N = force_N_psi * (drive.pressure_psi.front() - nominal_psi);
  integrate<1>(
      drive, {start_N},
      [&](const std::array<double, 1>& f, std::size_t i, double part) {
        return std::array{(force_N_psi * (within(drive.pressure_psi, i, part) - nominal_psi) - f[0]) / time_s};
      },
      [&](std::size_t i, const std::array<double, 1>& f) { force[i] = f[0]; });
  return force;
}

}  // namespace isorig::proof::foreign
