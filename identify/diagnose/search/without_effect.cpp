#include "identify/diagnose/search/without_effect.hpp"

#include <algorithm>

namespace isorig::identify {

std::size_t without_effect(Selection& selection, const Search& search, std::size_t from, const model::Physics& effect) {
  std::vector<const model::Physics*> rest = selection.pool[from].effects;
  std::erase(rest, &effect);
  const auto same = std::ranges::find_if(selection.pool, [&](const Hypothesis& h) {
    return h.effects == rest && h.empirical == selection.pool[from].empirical;
  });
  if (same != selection.pool.end()) return static_cast<std::size_t>(same - selection.pool.begin());
  selection.pool.push_back(search.without(selection.pool[from], effect));
  selection.weight.push_back(0.0);
  selection.excess.push_back(std::max(
      selection.pool.back().ls_chi2 / selection.noise_scale - static_cast<double>(selection.pool.back().fit.rows),
      0.0));
  return selection.pool.size() - 1;
}

bool move_weight(Selection& selection, const Search& search, const model::Physics& effect, double kept,
                 bool single_too) {
  constexpr double kLeastWeight = 1e-4;
  bool moved = false;
  for (std::size_t i = 0, count = selection.pool.size(); i < count; ++i) {
    if (!selection.pool[i].has(effect) || (!single_too && selection.pool[i].effects.size() < 2)) continue;
    if (selection.weight[i] < kLeastWeight) continue;
    const std::size_t rest = without_effect(selection, search, i, effect);
    const double given = (1.0 - kept) * selection.weight[i];
    selection.weight[i] -= given;
    selection.weight[rest] += given;
    moved = true;
  }
  return moved;
}

void count_weights(Selection& selection) {
  selection.best = static_cast<std::size_t>(std::ranges::max_element(selection.weight) - selection.weight.begin());
  selection.probability.clear();
  for (std::size_t i = 0; i < selection.pool.size(); ++i)
    for (const auto* effect : selection.pool[i].effects) selection.probability[effect] += selection.weight[i];
}

}  // namespace isorig::identify
