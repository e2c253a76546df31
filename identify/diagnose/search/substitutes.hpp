#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// How sure the chosen explanation is of one of its effects against the best explanation that has another effect in
/// its place, and all else alike:
///
///     w_chosen / (w_chosen + w_substitute)
///
/// 1 where no such explanation was tried. The weight of each is the one that it was given (Selection::weighed), less
/// what a discount has taken from it, without what a discount of others has added. No name is stated with more
/// (MissingEffect::weight). Where the chosen explanation was handed its weight by a larger one that the recordings
/// prefer to it, the larger one and its substitutes are compared, all before any discount. The sum of the weights of
/// all explanations that hold an effect cannot tell this: a search tries further effects beside the leading set and not
/// beside its rival, and each of these explanations adds to the leader's sum, or to the leader itself when its further
/// effect is discounted.
struct Substitute {
  const model::Physics* effect = nullptr;  ///< null: no such explanation was tried
  double share = 1.0;                      ///< of the chosen explanation beside that one
};
[[nodiscard]] Substitute best_substitute(const Selection& selection, const model::Physics& effect);

}  // namespace isorig::identify
