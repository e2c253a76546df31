#include "identify/diagnose/signal/noise_level.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/quantile.hpp"

namespace isorig::identify {

// With s = (t_k - t_k-1) / (t_k+1 - t_k-1), the distance of a reading from the line through its neighbours,
// y_k - (1 - s) y_k-1 - s y_k+1, has the variance noise^2 (1 + s^2 + (1 - s)^2). The median of many such distances,
// over Phi^-1(3/4), is a standard deviation that corners and outliers do not change (Rousseeuw & Croux 1993).
double white_noise(std::span<const double> t_s, std::span<const double> reading) {
  std::vector<double> bends;
  bends.reserve(t_s.size());
  for (std::size_t k = 1; k + 1 < t_s.size(); ++k) {
    const double share = (t_s[k] - t_s[k - 1]) / (t_s[k + 1] - t_s[k - 1]);
    const double bend = reading[k] - ((1.0 - share) * reading[k - 1] + share * reading[k + 1]);
    bends.push_back(std::fabs(bend) / std::sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share)));
  }
  return bends.empty() ? 0.0 : base::quantile(std::move(bends), 0.5) / base::kNormalQuartile;
}

// All differences are whole multiples of the smallest, to a twentieth of it; multiples beyond 1e4 say nothing, since
// rounding of the decimal text adds up there.
double quantisation(std::span<const double> reading) {
  double smallest = std::numeric_limits<double>::infinity();
  const std::size_t count = std::min<std::size_t>(reading.size(), 20000);
  for (std::size_t k = 1; k < count; ++k) {
    const double d = std::fabs(reading[k] - reading[k - 1]);
    if (d > 1e-12) smallest = std::min(smallest, d);
  }
  if (!std::isfinite(smallest)) return 0.0;
  for (std::size_t k = 1; k < count; ++k) {
    const double steps = (reading[k] - reading[k - 1]) / smallest;
    if (std::fabs(steps) < 1e4 && std::fabs(steps - std::round(steps)) > 0.05) return 0.0;
  }
  return smallest;
}

}  // namespace isorig::identify
