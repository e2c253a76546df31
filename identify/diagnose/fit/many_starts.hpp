#pragma once
#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// Every reading counts alike, whatever the time between them: under this noise a fit is ordinary least squares.
[[nodiscard]] NoiseModel plain(const NoiseModel& noise);

/// The best of many fits: from the spec's own numbers, from the starts of its laws, and from points spread evenly over
/// the ranges of all that is searched (Halton 1960). A few steps from each, all the way from the best of them.
[[nodiscard]] Fit fit_from_many_starts(const Problem& problem, const model::ModelSpec& spec, unsigned threads);

/// Sum of squares of a spec as it stands, in the units of Fit::chi2.
[[nodiscard]] double squares_of(const Problem& problem, const model::ModelSpec& spec);

}  // namespace isorig::identify
