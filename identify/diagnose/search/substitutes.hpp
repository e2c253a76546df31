#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// How sure the chosen explanation is of one of its effects against the best explanation that has another effect in
/// its place, and all else alike:
///
///     w_chosen / (w_chosen + w_substitute)
///
/// by the weights before any discount (Selection::weighed); 1 where no such explanation was tried. No name is stated
/// with more (MissingEffect::probability). The sum of the weights of all explanations that hold an effect cannot tell
/// this: a search tries further effects beside the leading set and not beside its rival, and each of these explanations
/// adds to the leader's sum, or to the leader itself when its further effect is discounted.
[[nodiscard]] double share_beside_substitute(const Selection& selection, const model::Physics& effect);

}  // namespace isorig::identify
