#pragma once
#include <Eigen/Dense>
#include <span>

#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// Degrees of freedom of the sum of squares of a residual whose values are neither independent nor of one size (Box
/// 1954; Bayley & Hammersley 1946): how many independent values would scatter as much. Per recording
///
///     n * (sum p)^2 / (B sum p^2) / (1 + 2 sum_k rho_k^2) / laps
///
///     n      bins
///     p      power of each of B blocks of 25 bins: an error that stands in few of them counts as few
///     rho_k  autocorrelation at k bins, until it falls below 0.1
///     laps   strokes in one direction: an error that comes back with every stroke is one error
[[nodiscard]] double effective_degrees_of_freedom(std::span<const Series> series, const Eigen::VectorXd& residual);

}  // namespace isorig::identify
