#include "identify/diagnose/search/practical_significance.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/search/without_effect.hpp"

namespace isorig::identify {
namespace {

Eigen::VectorXd change_N(const Search& search, const Hypothesis& with, const Hypothesis& without) {
  const Problem& problem = search.instrument_problem();
  return problem.predict(with.fit.spec) - problem.predict(without.fit.spec);
}

}  // namespace

double meeting_share(const Eigen::VectorXd& effect_N, const Eigen::VectorXd& all_N) {
  const Eigen::ArrayXd effect = effect_N.array().square(), all = all_N.array().square();
  const double at_effect = (effect * all).sum() / effect.sum(), at_all = (all * all).sum() / all.sum();
  return at_effect < at_all ? std::sqrt(at_effect / at_all) : 1.0;
}

double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without) {
  const Eigen::VectorXd change = change_N(search, with, without);
  std::vector<double> sizes(change.data(), change.data() + change.size());
  for (double& size : sizes) size = std::fabs(size);
  return base::quantile(std::move(sizes), deciding().size_quantile);
}

namespace {

/// Noise of a reading as measured, or the residual of the explanation if that is smaller: without rests, the change
/// that a drift or a softening makes between two strokes is counted as noise.
double noise_left_N(const Search& search, const Hypothesis& chosen, const SelectionOptions& options) {
  const double weighed_N = std::hypot(search.instrument().white_N, search.instrument().coloured_N);
  const double left = chosen.ls_chi2 / static_cast<double>(chosen.fit.rows);
  return std::min(weighed_N * std::sqrt(std::min(left, 1.0)), options.reading_noise_N);
}

bool depends_on_time_alone(const model::Physics& effect) {
  return effect.traits.depends_on == std::vector<std::string_view>{"time"};
}

/// The largest size of the other effects that depend on one thing alone, the same as `effect`; 0 for an effect that the
/// recording format lists. Of two functions of one thing, one may be the error of the other's formula.
double size_of_alike_N(const model::Physics& effect, const std::map<const model::Physics*, double>& sizes) {
  const model::PhysicsTraits& traits = effect.traits;
  double largest = 0.0;
  if (!traits.unusual || traits.depends_on.size() != 1 || !traits.refines.empty()) return largest;
  for (const auto& [other, size] : sizes)
    if (other != &effect && other->traits.event_name.empty() && other->traits.depends_on == traits.depends_on)
      largest = std::max(largest, size);
  return largest;
}

}  // namespace

double significance(const Search& search, const Hypothesis& chosen, const SelectionOptions& options, double size_N,
                    double largest_N, double alike_N) {
  const double error_N = std::hypot(options.model_error_noises * noise_left_N(search, chosen, options),
                                    options.model_error_share * largest_N, deciding().alike_error_share * alike_N);
  const double odds = std::pow(size_N / error_N, deciding().significance_exponent);
  return odds / (1.0 + odds);
}

void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options) {
  constexpr int kRounds = 8;
  std::set<const model::Physics*> done;
  selection.size_N.clear();
  for (int round = 0; round < kRounds; ++round) {
    const std::size_t chosen = selection.best;
    const auto effects = selection.pool[chosen].effects;
    // The size of all effects together: two effects that share a change of the force are each smaller than that change.
    double largest = size_N(search, selection.pool[chosen], selection.pool.front());
    double first = 0.0;
    std::map<const model::Physics*, double> sizes;
    for (const auto* effect : effects) {
      const std::size_t rest = without_effect_and_refinements(selection, search, chosen, *effect);
      sizes[effect] = size_N(search, selection.pool[chosen], selection.pool[rest]);
      first = std::max(first, sizes[effect]);
    }
    largest = std::max(largest, first);
    for (const auto& [effect, size] : sizes) selection.size_N[effect] = size;
    if (effects.size() < 2) break;
    // Only the smallest is discounted in a round. Two effects that can replace each other both look small, because each
    // is judged with the other in the model; discounting both at once would remove the one that is needed.
    const model::Physics* smallest = nullptr;
    for (const auto* effect : effects)
      if ((sizes[effect] < first || size_of_alike_N(*effect, sizes) > 0.0) && !done.contains(effect) &&
          !is_refined(selection.pool[chosen], *effect) && (smallest == nullptr || sizes[effect] < sizes[smallest]))
        smallest = effect;
    if (smallest == nullptr) break;
    done.insert(smallest);
    double met_N = largest;
    if (depends_on_time_alone(*smallest)) {
      const std::size_t rest = without_effect_and_refinements(selection, search, chosen, *smallest);
      met_N *= meeting_share(change_N(search, selection.pool[chosen], selection.pool[rest]),
                             change_N(search, selection.pool[chosen], selection.pool.front()));
    }
    const double kept = significance(search, selection.pool[chosen], options, sizes[smallest], met_N,
                                     size_of_alike_N(*smallest, sizes));
    move_weight(selection, search, *smallest, kept, false);
    count_weights(selection);
  }
  count_weights(selection);
  // What is chosen in the end has a size of each of its effects, whichever round it came from.
  const std::size_t chosen = selection.best;
  const auto effects = selection.pool[chosen].effects;
  for (const auto* effect : effects) {
    if (selection.size_N.contains(effect)) continue;
    const std::size_t rest = without_effect_and_refinements(selection, search, chosen, *effect);
    selection.size_N[effect] = size_N(search, selection.pool[chosen], selection.pool[rest]);
  }
}

}  // namespace isorig::identify
