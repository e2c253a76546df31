#include "identify/diagnose/noise/effective_dof.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/noise/repetitions.hpp"

namespace isorig::identify {

double effective_degrees_of_freedom(std::span<const Series> series, const Eigen::VectorXd& residual) {
  const auto block = static_cast<Eigen::Index>(deciding().freedom_block_bins);
  double degrees = 0.0;
  Eigen::Index first = 0;
  for (const Series& each : series) {
    const auto n = static_cast<Eigen::Index>(each.nodes.size());
    const auto r = residual.segment(first, n);
    first += n;
    const double power = r.squaredNorm();
    if (power <= 0.0 || n < 2 * block) continue;
    double correlated = 1.0;
    for (Eigen::Index lag = 1; lag < n / 4; ++lag) {
      const double rho = r.head(n - lag).dot(r.tail(n - lag)) / power;
      if (rho < deciding().correlation_gone) break;
      correlated += 2.0 * rho * rho;
    }
    double sum = 0.0, squares = 0.0;
    Eigen::Index blocks = 0;
    for (Eigen::Index b = 0; b + block <= n; b += block, ++blocks) {
      const double p = r.segment(b, block).squaredNorm();
      sum += p;
      squares += p * p;
    }
    const double spread = sum * sum / (static_cast<double>(blocks) * std::max(squares, 1e-300));
    const double laps = std::max(0.5 * static_cast<double>(stroke_count(each)), 1.0);
    degrees += static_cast<double>(n) * spread / correlated / laps;
  }
  return degrees;
}

}  // namespace isorig::identify
