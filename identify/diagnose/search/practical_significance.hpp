#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// How much of the force an effect stands for: 99th percentile over the bins of what the explanation changes
/// by when the effect is left out and all the rest refitted.
[[nodiscard]] double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without);

/// Significance is not enough for a second effect: every model of a real specimen errs by about the
/// instrument's noise and by some per cent of all that it lacked before (its law is never quite the right
/// one), and with 30 000 readings the best effect to take that up is always significant. An effect beside a
/// larger one is believed to be itself, and not such an error, with odds (size / model error)^4; the rest of
/// its weight goes to the explanation without it, which becomes the answer when it then weighs more.
void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options);

}  // namespace isorig::identify
