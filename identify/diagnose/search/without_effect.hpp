#pragma once
#include <cstddef>

#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// Where in the pool the explanation `from` stands without `effect`; fitted and put there, with no weight, if nobody
/// has tried it.
[[nodiscard]] std::size_t without_effect(Selection& selection, const Search& search, std::size_t from,
                                         const model::Physics& effect);

/// As without_effect(), and without what refines the effect: without dry friction there is nothing that could grow with
/// the load.
[[nodiscard]] std::size_t without_effect_and_refinements(Selection& selection, const Search& search, std::size_t from,
                                                         const model::Physics& effect);

/// Moves the share 1 - `kept` of the weight of every explanation that has `effect` to the same one without it, and says
/// whether any moved. Explanations of less than 1e-4 stay. `single_too`: those that have nothing else, too.
bool move_weight(Selection& selection, const Search& search, const model::Physics& effect, double kept,
                 bool single_too);

/// After weights have moved: which explanation weighs most, and how probable each effect is.
void count_weights(Selection& selection);

/// One of the explanation's effects refines this one (PhysicsTraits::refines) and is nothing without it: that one is to
/// be judged first. Without dry friction, what its growth with the pressure adds would be another law.
[[nodiscard]] bool is_refined(const Hypothesis& explanation, const model::Physics& effect);

}  // namespace isorig::identify
