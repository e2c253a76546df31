#include "identify/diagnose/search/substitutes.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify {
namespace {

/// What `other` has in the place of `effect`, all else as in `chosen`; null where it is not such an explanation.
const model::Physics* in_place_of(const model::Physics& effect, const Hypothesis& chosen, const Hypothesis& other) {
  if (other.effects.size() != chosen.effects.size() || other.empirical != chosen.empirical || other.has(effect))
    return nullptr;
  const model::Physics* found = nullptr;
  for (const model::Physics* each : other.effects) {
    if (chosen.has(*each)) continue;
    if (found != nullptr) return nullptr;
    found = each;
  }
  return found;
}

/// The chosen explanation, or the larger one that handed it its weight where the recordings prefer that one by more
/// than an effect costs: what they say of explanations that both leave much is no comparison of two effects.
std::size_t compared_with_others(const Selection& selection) {
  const Hypothesis& chosen = selection.chosen();
  std::size_t most = selection.best;
  for (std::size_t i = 0; i < selection.weighed.size(); ++i) {
    const Hypothesis& other = selection.pool[i];
    if (other.empirical != chosen.empirical || selection.weighed[i] <= selection.weighed[most]) continue;
    if (selection.weight[i] >= selection.weighed[i]) continue;  // it has handed nothing on
    if (std::ranges::all_of(chosen.effects, [&](const auto* effect) { return other.has(*effect); })) most = i;
  }
  const double times = std::exp(SelectionOptions{}.prior_cost);
  return selection.weighed[most] > times * selection.weighed[selection.best] ? most : selection.best;
}

}  // namespace

Substitute best_substitute(const Selection& selection, const model::Physics& effect) {
  const std::size_t compared = selection.weighed.size();
  if (selection.best >= compared) return {};
  const std::size_t at = compared_with_others(selection);
  const auto own = [&](std::size_t i) {
    return at == selection.best ? std::min(selection.weighed[i], selection.weight[i]) : selection.weighed[i];
  };
  Substitute best;
  double most = 0.0;
  for (std::size_t i = 0; i < compared; ++i) {
    const model::Physics* other = in_place_of(effect, selection.pool[at], selection.pool[i]);
    if (other == nullptr || own(i) <= most) continue;
    most = own(i);
    best.effect = other;
  }
  if (best.effect != nullptr) best.share = own(at) / (own(at) + most);
  return best;
}

}  // namespace isorig::identify
