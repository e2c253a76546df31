#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/fit.hpp"

namespace isorig::identify {

struct NamedValue {
  std::string name;
  double value = 0.0;
  double low = 0.0;  ///< 95 % interval
  double high = 0.0;
};

/// Parameters and coefficients of every part, in the order of the spec, with 95 % intervals from the
/// curvature of the likelihood. Whitened by the fit's own noise, which takes up model error: the intervals
/// grow with what is left.
[[nodiscard]] std::vector<std::vector<NamedValue>> intervals(const Problem& problem,
                                                             const model::ModelSpec& spec);

}  // namespace isorig::identify
