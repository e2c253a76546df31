#include <numbers>

#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {
namespace {

double sign(double v) noexcept {
  return v > 0.0 ? 1.0 : v < 0.0 ? -1.0 : 0.0;
}

/// A bristle that starts relaxed: rate(z, velocity) gives dz/dt; the force is scale(node) (z + damping dz/dt).
template <class Rate, class Scale>
Signal bristle(const Drive& drive, const Rate& rate, const Scale& scale, double damping_s = 0.0) {
  Signal force(drive.size());
  integrate<1>(
      drive, {0.0},
      [&](const std::array<double, 1>& z, std::size_t i, double part) {
        return std::array{rate(z[0], drive.velocity_within(i, part))};
      },
      [&](std::size_t i, const std::array<double, 1>& z) {
        force[i] = scale(i) * (z[0] + damping_s * rate(z[0], drive.velocity_mm_s[i]));
      });
  return force;
}

}  // namespace

Signal dahl_square(const Drive& drive, double force_N, double presliding_mm) {
  return bristle(
      drive,
      [presliding_mm](double z, double v) {
        const double gap = 1.0 - z * sign(v);
        return v / presliding_mm * sign(gap) * gap * gap;
      },
      [force_N](std::size_t) { return force_N; });
}

Signal bouc_wen(const Drive& drive, double force_N, double presliding_mm, double exponent, double gamma) {
  const double beta = 1.0 - gamma;
  return bristle(
      drive,
      [=](double z, double v) {
        const double power = std::pow(std::abs(z), exponent - 1.0);
        return (v - beta * std::abs(v) * power * z - gamma * v * power * std::abs(z)) / presliding_mm;
      },
      [force_N](std::size_t) { return force_N; });
}

Signal lugre_half(const Drive& drive, double force_N, double presliding_mm, double excess, double stribeck_mm_s) {
  // Bristle damping of one millisecond times the bristle's stiffness: far from the limit at which LuGre with Stribeck
  // weakening loses passivity (Barahanov & Ortega 2000).
  constexpr double kDamping_s = 1e-3;
  return bristle(
      drive,
      [=](double z, double v) {
        const double g = 1.0 + excess * std::exp(-std::sqrt(std::abs(v) / stribeck_mm_s));
        return (v - std::abs(v) * z / g) / presliding_mm;
      },
      [force_N](std::size_t) { return force_N; }, kDamping_s);
}

Signal prandtl_ishlinskii(const Drive& drive, double force_N, double reach_mm, double asymmetry) {
  constexpr std::size_t kStops = 12;
  Signal force(drive.size(), 0.0);
  for (std::size_t n = 0; n < kStops; ++n) {
    // Thresholds denser where they are small, as the density e^-r of the usual model asks.
    const double threshold_mm = reach_mm * std::pow((static_cast<double>(n) + 0.5) / kStops, 2.0);
    const double high_mm = threshold_mm * (1.0 + asymmetry), low_mm = -threshold_mm * (1.0 - asymmetry);
    double stretch_mm = 0.0;
    for (std::size_t i = 1; i < drive.size(); ++i) {
      const double move_mm = drive.position_mm[i] - drive.position_mm[i - 1];
      stretch_mm = std::clamp(stretch_mm + move_mm, low_mm, high_mm);
      force[i] += force_N / kStops * stretch_mm / threshold_mm;
    }
  }
  return force;
}

Signal arctan_friction(const Drive& drive, double force_N, double velocity_mm_s) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < drive.size(); ++i)
    force[i] = force_N * 2.0 / std::numbers::pi * std::atan(drive.velocity_mm_s[i] / velocity_mm_s);
  return force;
}

Signal load_friction(const Drive& drive, double friction_coefficient, double presliding_mm) {
  return bristle(
      drive, [presliding_mm](double z, double v) { return (v - std::abs(v) * z * z * z) / presliding_mm; },
      [&](std::size_t i) { return friction_coefficient * std::abs(drive.specimen_N[i]); });
}

}  // namespace isorig::proof::foreign
