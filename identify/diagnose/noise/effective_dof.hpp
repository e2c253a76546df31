#pragma once
#include <Eigen/Dense>
#include <span>

#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// How many independent looks at a model's error its residual holds: the degrees of freedom of the residual's
/// sum of squares (Box 1954), by its correlation in time and by how unevenly its power is spread, divided by
/// the strokes in the same direction, since an error that comes back with every stroke is one error.
[[nodiscard]] double effective_degrees_of_freedom(std::span<const Series> series, const Eigen::VectorXd& residual);

}  // namespace isorig::identify
