#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {
namespace {

/// Root v >= 0 of a concave, increasing force(v) = |force_N|, sign restored. Newton's steps from v = 0 approach it from
/// below without overshooting, since the tangent of a concave function lies above it.
template <class Law>
double flow_of(double force_N, const Law& law) {
  const double wanted_N = std::abs(force_N);
  double v = 0.0;
  for (int round = 0; round < 60; ++round) {
    const auto [at_N, slope] = law(v);
    const double step = (wanted_N - at_N) / slope;
    v += step;
    if (std::abs(step) <= 1e-12 * v + 1e-15) break;
  }
  return std::copysign(v, force_N);
}

}  // namespace

Flow eyring(double viscosity_N_s_mm, double force_N) {
  return [=](double f) { return force_N / viscosity_N_s_mm * std::sinh(f / force_N); };
}

Flow cross(double viscosity_N_s_mm, double rate_mm_s, double exponent) {
  return [=](double f) {
    return flow_of(f, [=](double v) {
      const double thin = std::pow(v / rate_mm_s, exponent);
      const double below = 1.0 + thin;
      return std::pair{viscosity_N_s_mm * v / below,
                       viscosity_N_s_mm * (1.0 + (1.0 - exponent) * thin) / (below * below)};
    });
  };
}

Flow carreau(double viscosity_N_s_mm, double rate_mm_s, double exponent) {
  return [=](double f) {
    return flow_of(f, [=](double v) {
      const double u = v / rate_mm_s, base = 1.0 + u * u;
      const double factor = viscosity_N_s_mm * std::pow(base, 0.5 * (exponent - 1.0));
      return std::pair{factor * v, factor * (1.0 + exponent * u * u) / base};
    });
  };
}

Flow papanastasiou(double viscosity_N_s_mm, double yield_N, double rate_mm_s) {
  return [=](double f) {
    return flow_of(f, [=](double v) {
      const double left = std::exp(-v / rate_mm_s);
      return std::pair{viscosity_N_s_mm * v + yield_N * (1.0 - left), viscosity_N_s_mm + yield_N / rate_mm_s * left};
    });
  };
}

Signal arm_force(const Drive& drive, double stiffness_N_mm, const Flow& flow) {
  Signal force(drive.size());
  integrate<1>(
      drive, {0.0},
      [&](const std::array<double, 1>& z, std::size_t i, double part) {
        return std::array{drive.velocity_within(i, part) - flow(stiffness_N_mm * z[0])};
      },
      [&](std::size_t i, const std::array<double, 1>& z) { force[i] = stiffness_N_mm * z[0]; });
  return force;
}

}  // namespace isorig::proof::foreign
