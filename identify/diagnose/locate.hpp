#pragma once
#include <vector>

#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {

/// Where the nominal model misses: times, and the variables that carry the excess, with shares of the excess
/// residual power (block bootstrap intervals).
[[nodiscard]] std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal,
                                        double noise_scale);

}  // namespace isorig::identify
