#pragma once
#include <algorithm>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

/// The frequency with which a claim would be right, were weights frequencies. Where something stays unexplained, every
/// name found beside it may be a part of that.
[[nodiscard]] inline double promised(double weight, double unexplained) noexcept {
  return std::clamp(weight, 0.0, 1.0) * (1.0 - std::clamp(unexplained, 0.0, deciding().most_unexplained_counted));
}

/// Turns the weight of an explanation into the frequency with which such a claim is right. Weights compare entries of
/// the catalogue alone; physics that it lacks can resemble one of them. Fitted on development seeds of isorig-proof
/// (docs/diagnosis.md has the numbers and the command that measures them again); reliability/ measures it on the
/// recording itself.
[[nodiscard]] inline double calibrated(double weight, double unexplained, bool unknown_left) noexcept {
  return promised(weight, unexplained) *
         (unknown_left ? deciding().surest_beside_unknown_probability : deciding().surest_probability);
}

/// Of a name whose law is not in the model that is handed out: the fit speaks for the name, left-out readings of the
/// same recordings against its law. Of four such names above 0.9 on looked-at seeds (20261124 of the catalogue's
/// generator, 20261127 of the foreign one) two were right.
[[nodiscard]] inline double stated_if_refused(double probability) noexcept {
  return std::min(probability, deciding().refused_law_probability);
}

}  // namespace isorig::identify
