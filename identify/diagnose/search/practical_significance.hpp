#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// How much of the force an effect stands for: 99th percentile over the bins of what the explanation changes
/// by when the effect is left out and all the rest refitted.
[[nodiscard]] double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without);

/// Statistical significance is not enough to name a second effect. The law found for the first is never quite the
/// right one: it errs by about two noises of a reading and by 8 % of all that the nominal model lacked. With 30 000
/// readings, whatever effect takes up such an error best is significant. So an effect beside a larger one is believed
///
///     with odds (size / e)^4,   e = hypot(2 noise, 0.08 largest)
///
/// and the rest of its weight goes to the explanation without it, which becomes the answer when it then weighs more:
/// the smallest effect first, then what remains is looked at anew. The noise is as measured, or what the explanation
/// leaves if that is less. The fourth power is fitted: it takes an effect of half the error's size to 6 % and of twice
/// its size to 94 %.
void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options);

}  // namespace isorig::identify
