#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// Of the chosen explanation: a law one of whose numbers stands at its bound, or whose interval holds the
/// value at which the law becomes a simpler one (no weakening, no second coefficient), gives way to the best
/// simpler law of the same effect. So does a law of five coefficients or more, which describes but does not
/// predict, where a simpler one says the same to within the noise. Last, what stands at the end of a range all the
/// same gives way to any other law of its effect (Search::inside_ranges).
void prefer_simpler_laws(Selection& selection, const Search& search);

}  // namespace isorig::identify
