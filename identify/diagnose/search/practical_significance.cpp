#include "identify/diagnose/search/practical_significance.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/quantile.hpp"

namespace isorig::identify {
namespace {

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

}  // namespace

double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without) {
  const Problem& problem = search.instrument_problem();
  const Eigen::VectorXd change = problem.predict(with.fit.spec) - problem.predict(without.fit.spec);
  std::vector<double> sizes(change.data(), change.data() + change.size());
  for (double& size : sizes) size = std::fabs(size);
  return base::quantile(std::move(sizes), 0.99);
}

void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options) {
  const double noise_N = std::hypot(search.instrument().white_N, search.instrument().coloured_N);
  std::set<const model::Physics*> done;
  selection.size_N.clear();
  for (int round = 0; round < 4; ++round) {
    const std::size_t chosen = selection.best;
    const auto effects = selection.pool[chosen].effects;
    // Of all that the nominal model lacked: effects that share a part of it are each smaller than it.
    double largest = size_N(search, selection.pool[chosen], selection.pool.front());
    double first = 0.0;
    std::map<const model::Physics*, double> sizes;
    for (const auto* effect : effects) {
      const std::size_t rest = without_effect(selection, search, chosen, *effect);
      sizes[effect] = size_N(search, selection.pool[chosen], selection.pool[rest]);
      first = std::max(first, sizes[effect]);
    }
    largest = std::max(largest, first);
    for (const auto& [effect, size] : sizes) selection.size_N[effect] = size;
    if (effects.size() < 2) break;
    const double error_N = std::hypot(options.model_error_noises * noise_N, options.model_error_share * largest);
    bool moved = false;
    for (const auto* effect : effects) {
      if (sizes[effect] == first || !done.insert(effect).second) continue;
      const double odds = std::pow(sizes[effect] / error_N, 4.0);
      const double kept = odds / (1.0 + odds);
      for (std::size_t i = 0, count = selection.pool.size(); i < count; ++i) {
        if (!selection.pool[i].has(*effect) || selection.pool[i].effects.size() < 2) continue;
        if (selection.weight[i] < 1e-4) continue;
        const std::size_t rest = without_effect(selection, search, i, *effect);
        const double given = (1.0 - kept) * selection.weight[i];
        selection.weight[i] -= given;
        selection.weight[rest] += given;
        moved = true;
      }
    }
    selection.best = static_cast<std::size_t>(std::ranges::max_element(selection.weight) - selection.weight.begin());
    if (!moved) break;
  }
  selection.probability.clear();
  for (std::size_t i = 0; i < selection.pool.size(); ++i)
    for (const auto* effect : selection.pool[i].effects) selection.probability[effect] += selection.weight[i];
}

}  // namespace isorig::identify
