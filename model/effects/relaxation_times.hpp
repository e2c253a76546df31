#pragma once
#include <span>
#include <vector>

#include "model/process.hpp"

namespace isorig::model::effect {

/// Time constants (s) of the Maxwell arms that a law of second_relaxation consists of. `parameters`: as its parameters.
[[nodiscard]] std::vector<double> relaxation_times_s(const Law& law, std::span<const double> parameters);

}  // namespace isorig::model::effect
