#include "identify/diagnose/search/substitutes.hpp"

#include <algorithm>

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

}  // namespace

Substitute best_substitute(const Selection& selection, const model::Physics& effect) {
  const std::size_t compared = selection.weighed.size();
  if (selection.best >= compared) return {};
  const auto own = [&](std::size_t i) { return std::min(selection.weighed[i], selection.weight[i]); };
  Substitute best;
  double most = 0.0;
  for (std::size_t i = 0; i < compared; ++i) {
    const model::Physics* other = in_place_of(effect, selection.chosen(), selection.pool[i]);
    if (other == nullptr || own(i) <= most) continue;
    most = own(i);
    best.effect = other;
  }
  const double chosen = own(selection.best);
  if (best.effect != nullptr) best.share = chosen / (chosen + most);
  return best;
}

}  // namespace isorig::identify
