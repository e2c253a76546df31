#include <numbers>

#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {
namespace {
// The trapezoidal rule in the logarithm of the rate: with four nodes a decade its own error is below 1e-6.
const double kLogStep = std::log(10.0) / 4.0;
}  // namespace

std::vector<SpectralArm> springpot(double alpha, double shortest_s, double longest_s) {
  // t^-a / Gamma(1 - a) = sin(pi a) / pi * integral of u^(a-1) exp(-u t) du. Slower than a hundredth of 1 / longest the
  // exponential is one, and the rest of the integral a spring.
  const double factor = std::sin(std::numbers::pi * alpha) / std::numbers::pi;
  std::vector<SpectralArm> arms;
  const double slowest = 1e-2 / longest_s, fastest = 30.0 / shortest_s;
  const double edge = slowest * std::exp(-0.5 * kLogStep);
  arms.push_back({factor * std::pow(edge, alpha) / alpha, 1e9 * longest_s});
  for (double u = slowest; u < fastest; u *= std::exp(kLogStep))
    arms.push_back({factor * std::pow(u, alpha) * kLogStep, 1.0 / u});
  return arms;
}

std::vector<SpectralArm> log_normal(double time_s, double decades) {
  std::vector<SpectralArm> arms;
  double sum = 0.0;
  const double step = 0.25 * decades;
  for (int n = -14; n <= 14; ++n) {
    const double at = step * n;
    arms.push_back({std::exp(-0.5 * at * at / (decades * decades)), time_s * std::pow(10.0, at)});
    sum += arms.back().weight;
  }
  for (SpectralArm& arm : arms) arm.weight /= sum;
  return arms;
}

std::vector<SpectralArm> kohlrausch_half(double time_s) {
  std::vector<SpectralArm> arms;
  constexpr double kFastest = 1e5;
  for (double u = 0.01; u < kFastest; u *= std::exp(kLogStep))
    arms.push_back({std::exp(-0.25 / u) / (2.0 * std::sqrt(std::numbers::pi * u)) * kLogStep, time_s / u});
  return arms;
}

double relaxation_at(std::span<const SpectralArm> arms, double t_s) {
  double sum = 0.0;
  for (const SpectralArm& arm : arms) sum += arm.weight * std::exp(-t_s / arm.time_s);
  return sum;
}

Signal relax(const Signal& t_s, const Signal& driving, std::span<const SpectralArm> arms, double stiffness_N_mm) {
  Signal force(t_s.size(), 0.0);
  for (const SpectralArm& arm : arms) {
    double stretch = 0.0;
    for (std::size_t i = 1; i < t_s.size(); ++i) {
      const double ratio = (t_s[i] - t_s[i - 1]) / arm.time_s;
      const double lost = -std::expm1(-ratio);
      stretch += -stretch * lost + (driving[i] - driving[i - 1]) * lost / ratio;
      force[i] += stiffness_N_mm * arm.weight * stretch;
    }
  }
  return force;
}

}  // namespace isorig::proof::foreign
