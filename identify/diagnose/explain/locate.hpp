#pragma once
#include <vector>

#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {

/// Where the nominal model misses: the variables that carry the excess, with their shares of the excess
/// residual power (95 %, bootstrap over moves) and where along them half of it stands; then stretches of time
/// (95 % of the noise's own scatter). Each with the error of both models there.
[[nodiscard]] std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal,
                                        const model::ModelSpec& model, double noise_scale);

}  // namespace isorig::identify
