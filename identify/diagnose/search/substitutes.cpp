#include "identify/diagnose/search/substitutes.hpp"

#include <algorithm>

namespace isorig::identify {
namespace {

/// `other` is `chosen` with a single effect in the place of `effect`.
bool substitutes(const Hypothesis& other, const Hypothesis& chosen, const model::Physics& effect) {
  if (other.effects.size() != chosen.effects.size() || other.empirical != chosen.empirical || other.has(effect))
    return false;
  return std::ranges::count_if(chosen.effects, [&](const model::Physics* each) { return !other.has(*each); }) == 1;
}

}  // namespace

double share_beside_substitute(const Selection& selection, const model::Physics& effect) {
  const std::size_t compared = selection.weighed.size();
  if (selection.best >= compared) return 1.0;
  const auto own = [&](std::size_t i) { return std::min(selection.weighed[i], selection.weight[i]); };
  double most = 0.0;
  for (std::size_t i = 0; i < compared; ++i)
    if (substitutes(selection.pool[i], selection.chosen(), effect)) most = std::max(most, own(i));
  const double chosen = own(selection.best);
  return chosen + most > 0.0 ? chosen / (chosen + most) : 1.0;
}

}  // namespace isorig::identify
