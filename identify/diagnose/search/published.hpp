#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// The nominal model as it is handed out, with the noise under which it was fitted.
///
/// The search compares explanations by likelihood, each under the noise that it was left with. A model that lacks much
/// is left with a noise that wanders, and generalised least squares under such a noise fit the differences from one
/// reading to the next and give up the force itself. That is right for weighing, where the wandering part is what an
/// effect will explain, and wrong for numbers that somebody is to predict with. Those are the ordinary least squares of
/// the usable rows, from many starts, as soon as they leave clearly less: under noise alone the two agree.
[[nodiscard]] Fit published_nominal(const Search& search, const Selection& selection,
                                    std::span<const std::vector<bool>> usable, unsigned threads);

/// The laws' own error, not the noise, makes most of what an explanation leaves (kErrorRules).
[[nodiscard]] bool errs_more_than_noise(const Hypothesis& hypothesis);

}  // namespace isorig::identify
