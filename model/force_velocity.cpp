#include "model/force_velocity.hpp"

#include <cmath>
#include <limits>

namespace isorig::model {

double maxwell_ramp_share(double u) noexcept {
  return u < 1e-300 ? 1.0 : -std::expm1(-u) / u;
}

double ramp_force_N(const StandardLinearSolid& element, double initial_strain, double rate_per_s, double t_s) noexcept {
  const double u = element.gamma_per_s() * t_s;
  // eta rate (1 - e^-u) = k2 (rate t) phi(u): the same, and safe for eta -> infinity.
  return element.k1_N * (initial_strain + rate_per_s * t_s) + element.k2_N * rate_per_s * t_s * maxwell_ramp_share(u);
}

double hold_force_N(const StandardLinearSolid& element, double initial_strain, double rate_per_s, double ramp_s,
                    double t_s) noexcept {
  const double step = rate_per_s * ramp_s;
  const double arm_strain = step * maxwell_ramp_share(element.gamma_per_s() * ramp_s);
  return element.k1_N * (initial_strain + step) + element.k2_N * arm_strain * std::exp(-element.gamma_per_s() * t_s);
}

// Delta FV = deps / eps0 * sum beta_i kappa_i phi(u_i) / sum beta_i,   u_i = gamma_i deps / |rate|   (eqs. 5 and 8)
double fv_height(std::span<const FvElement> elements, const FvTest& test, double rate_per_s) noexcept {
  if (rate_per_s == 0.0) return 0.0;
  double weighted = 0.0;
  double weight = 0.0;
  for (const FvElement& e : elements) {
    weighted += e.beta * e.kappa * maxwell_ramp_share(e.gamma_per_s * test.strain_step / std::abs(rate_per_s));
    weight += e.beta;
  }
  return std::copysign(test.strain_step / test.initial_strain * weighted / weight, rate_per_s);
}

double force_velocity(std::span<const FvElement> elements, const FvTest& test, double rate_per_s) noexcept {
  if (rate_per_s == 0.0) return 1.0;
  return 1.0 + std::copysign(test.strain_step / test.initial_strain, rate_per_s) +
         fv_height(elements, test, rate_per_s);
}

// phi(u) -> 1 as the rate grows: deps / eps0 * sum beta_i kappa_i / sum beta_i   (eqs. 6 and 9)
double fv_asymptote(std::span<const FvElement> elements, const FvTest& test) noexcept {
  double weighted = 0.0;
  double weight = 0.0;
  for (const FvElement& e : elements) {
    weighted += e.beta * e.kappa;
    weight += e.beta;
  }
  return test.strain_step / test.initial_strain * weighted / weight;
}

// phi(u) = 1 - u / 2 + O(u^2), so 1 - alpha = deps / (2 v) * sum beta kappa gamma / sum beta kappa   (eqs. 7 and 10)
double rate_at_share_approximate(std::span<const FvElement> elements, const FvTest& test, double alpha) noexcept {
  double weighted = 0.0;
  double weight = 0.0;
  for (const FvElement& e : elements) {
    weighted += e.beta * e.kappa * e.gamma_per_s;
    weight += e.beta * e.kappa;
  }
  return test.strain_step / (2.0 * (1.0 - alpha)) * weighted / weight;
}

double share_of_asymptote(std::span<const FvElement> elements, const FvTest& test, double rate_per_s) noexcept {
  return std::abs(fv_height(elements, test, rate_per_s)) / fv_asymptote(elements, test);
}

double rate_at_share(std::span<const FvElement> elements, const FvTest& test, double alpha) noexcept {
  const double guess = rate_at_share_approximate(elements, test, alpha);
  if (!(alpha > 0.0 && alpha < 1.0) || !(guess > 0.0) || !std::isfinite(guess))
    return std::numeric_limits<double>::quiet_NaN();
  // phi(u) >= 1 - u/2, so the share at the guess is at least alpha: the root lies below it.
  double high = guess;
  double low = guess;
  while (share_of_asymptote(elements, test, low) > alpha) low *= 0.5;
  for (int i = 0; i < 200 && high - low > 4e-16 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (share_of_asymptote(elements, test, middle) > alpha ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace isorig::model
