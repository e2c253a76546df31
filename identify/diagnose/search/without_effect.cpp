#include "identify/diagnose/search/without_effect.hpp"

#include <algorithm>
#include <optional>

#include "identify/diagnose/search/resolution.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {

namespace {

std::optional<std::size_t> find_in_pool(const Selection& selection, const std::vector<const model::Physics*>& effects,
                                        const std::string& empirical) {
  const auto same = std::ranges::find_if(
      selection.pool, [&](const Hypothesis& h) { return h.effects == effects && h.empirical == empirical; });
  if (same == selection.pool.end()) return std::nullopt;
  return static_cast<std::size_t>(same - selection.pool.begin());
}

/// Refitted without the effect, another effect may stand at the bound where its law is a third effect. The explanation
/// is then the one with that third effect, if it was tried.
std::optional<std::size_t> under_right_names(const Selection& selection, const Hypothesis& hypothesis) {
  std::vector<const model::Physics*> effects;
  for (const auto* effect : hypothesis.effects) effects.push_back(&effect_at_bound(hypothesis.fit.spec, *effect));
  if (effects == hypothesis.effects) return std::nullopt;
  sort_as_in_catalogue(effects);
  return find_in_pool(selection, effects, hypothesis.empirical);
}

}  // namespace

std::size_t without_effect(Selection& selection, const Search& search, std::size_t from, const model::Physics& effect) {
  std::vector<const model::Physics*> rest = selection.pool[from].effects;
  std::erase(rest, &effect);
  if (const auto same = find_in_pool(selection, rest, selection.pool[from].empirical)) return *same;
  Hypothesis fitted = search.without(selection.pool[from], effect);
  if (const auto named = under_right_names(selection, fitted)) return *named;
  // With fewer arms another effect may have become one of the model's own (count_arms).
  if (const auto same = find_in_pool(selection, fitted.effects, fitted.empirical)) return *same;
  selection.pool.push_back(std::move(fitted));
  selection.weight.push_back(0.0);
  selection.excess.push_back(std::max(
      selection.pool.back().ls_chi2 / selection.noise_scale - static_cast<double>(selection.pool.back().fit.rows),
      0.0));
  return selection.pool.size() - 1;
}

std::size_t without_effect_and_refinements(Selection& selection, const Search& search, std::size_t from,
                                           const model::Physics& effect) {
  const auto effects = selection.pool[from].effects;
  for (const auto* other : effects)
    if (other->traits.refines == effect.name) from = without_effect(selection, search, from, *other);
  return without_effect(selection, search, from, effect);
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

bool is_refined(const Hypothesis& explanation, const model::Physics& effect) {
  return std::ranges::any_of(explanation.effects,
                             [&](const model::Physics* other) { return other->traits.refines == effect.name; });
}

}  // namespace isorig::identify
