#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// The size of an effect: 99th percentile over the bins of the change in force when the effect is left out and
/// everything else is refitted.
[[nodiscard]] double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without);

/// Statistical significance is not enough to name a second effect. The law found for the first is never exactly right:
/// its error is about a noise of a reading and 8 % of the largest effect. With 30 000 readings, the effect that fits
/// such an error best is statistically significant. An effect beside a larger one is therefore believed
///
///     with odds (size / e)^4,   e = hypot(noise, 0.08 largest, alike)
///
/// and the rest of its weight goes to the explanation without it, which becomes the answer if it then has more weight.
/// `alike` is for an effect beyond the recording format's thirteen that depends on a single thing: the size of another
/// effect that depends on that thing alone, since of two functions of time one may be the error of the other's formula.
/// The smallest effect is judged first, then the others again. The noise is as measured, or the residual of the
/// explanation if that is smaller. The fourth power is fitted: it takes an effect of half the error's size to 6 % and
/// of twice its size to 94 %.
void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options);

/// What an effect of `size_N` keeps of its weight beside the others of `chosen`, the largest of which has `largest_N`
/// (and one that it may be the error of, `alike_N`): the odds of above as a probability.
[[nodiscard]] double significance(const Search& search, const Hypothesis& chosen, const SelectionOptions& options,
                                  double size_N, double largest_N, double alike_N = 0.0);

}  // namespace isorig::identify
