#include "identify/fv/statistics.hpp"

#include <cmath>
#include <initializer_list>

namespace isorig::identify {
namespace {

/// 1 / (1 + d_1 / (1 + d_2 / (1 + ...))) with (Abramowitz & Stegun 1964, 26.5.8)
///
///     d_2m = m (b - m) x / ((a + 2m - 1)(a + 2m)),   d_2m+1 = -(a + m)(a + b + m) x / ((a + 2m)(a + 2m + 1))
///
/// by Lentz's method as Thompson & Barnett (1986) have it, denominators and numerators kept off zero. Converges fast
/// for x < (a + 1) / (a + b + 2).
double beta_fraction(double a, double b, double x) {
  constexpr double kTiny = 1e-300;
  double c = 1.0;
  double d = 1.0 - (a + b) * x / (a + 1.0);
  d = 1.0 / (std::abs(d) < kTiny ? kTiny : d);
  double h = d;
  for (int m = 1; m < 500; ++m) {
    const double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
    double change = 1.0;
    for (double step : {even, odd}) {
      d = 1.0 + step * d;
      d = 1.0 / (std::abs(d) < kTiny ? kTiny : d);
      c = 1.0 + step / c;
      if (std::abs(c) < kTiny) c = kTiny;
      change = c * d;
      h *= change;
    }
    if (std::abs(change - 1.0) < 1e-15) break;
  }
  return h;
}

}  // namespace

// I_x(a, b) = x^a (1 - x)^b / (a B(a, b)) * fraction, B(a, b) = Gamma(a) Gamma(b) / Gamma(a + b); for large x by
// I_x(a, b) = 1 - I_1-x(b, a).
double incomplete_beta(double a, double b, double x) {
  if (x <= 0.0) return 0.0;
  if (x >= 1.0) return 1.0;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  if (x < (a + 1.0) / (a + b + 2.0)) return front * beta_fraction(a, b, x) / a;
  return 1.0 - front * beta_fraction(b, a, 1.0 - x) / b;
}

double student_t_quantile(double probability, double freedom) {
  if (probability == 0.5) return 0.0;
  const double tail = probability > 0.5 ? 1.0 - probability : probability;
  // P(|T| > t) = I_{n/(n+t^2)}(n/2, 1/2)
  auto beyond = [&](double t) { return 0.5 * incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t)); };
  double low = 0.0, high = 1.0;
  while (beyond(high) > tail && high < 1e15) high *= 2.0;
  for (int i = 0; i < 200 && high - low > 1e-12 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (beyond(middle) > tail ? low : high) = middle;
  }
  return std::copysign(0.5 * (low + high), probability - 0.5);
}

}  // namespace isorig::identify
