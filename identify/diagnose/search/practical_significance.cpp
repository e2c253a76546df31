#include "identify/diagnose/search/practical_significance.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/quantile.hpp"
#include "identify/diagnose/search/without_effect.hpp"

namespace isorig::identify {
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
      moved = move_weight(selection, search, *effect, odds / (1.0 + odds), false) || moved;
    }
    count_weights(selection);
    if (!moved) break;
  }
  count_weights(selection);
}

}  // namespace isorig::identify
