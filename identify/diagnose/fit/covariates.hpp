#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {

/// What may carry the excess: one value per bin of all series in a row.
struct Covariates {
  std::vector<double> time_s, position_mm, strain_percent, rate_mm_s, since_s, travel_mm, pressure_psi, readings;
  std::vector<int> direction;       ///< of the velocity: 0 shortening, 1 at rest, 2 lengthening
  std::vector<int> last_direction;  ///< of the motion last made; 1 before the first
  MoveNumbers moves;
};
[[nodiscard]] Covariates covariates_of(std::span<const Series> series);

}  // namespace isorig::identify
