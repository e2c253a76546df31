#pragma once
#include <algorithm>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

/// Turns the weight of an explanation into the frequency with which such a claim is right. Weights compare entries of
/// the catalogue alone; physics that it lacks can resemble one of them. Fitted on development seeds of isorig-proof
/// (docs/diagnosis.md has the numbers and the command that measures them again).
[[nodiscard]] inline double calibrated(double weight, double unexplained, bool unknown_left) noexcept {
  // Where something stays unexplained, every name found beside it may be a part of that.
  const double known = 1.0 - std::clamp(unexplained, 0.0, deciding().most_unexplained_counted);
  return std::clamp(weight, 0.0, 1.0) * known *
         (unknown_left ? deciding().surest_beside_unknown_probability : deciding().surest_probability);
}

/// Of a name whose law is not in the model that is handed out: the fit speaks for the name, left-out readings of the
/// same recordings against its law. Of four such names above 0.9 on looked-at seeds (20261124 of the catalogue's
/// generator, 20261127 of the foreign one) two were right.
[[nodiscard]] inline double stated_if_refused(double probability) noexcept {
  return std::min(probability, deciding().refused_law_probability);
}

}  // namespace isorig::identify
