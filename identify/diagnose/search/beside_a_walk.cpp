#include "identify/diagnose/search/beside_a_walk.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/search/parsimony.hpp"
#include "identify/diagnose/search/practical_significance.hpp"
#include "identify/diagnose/search/published.hpp"
#include "identify/diagnose/search/repeated_evidence.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

constexpr double kLikelierThanNot = 0.5;

struct Wander {
  const model::Physics* effect = nullptr;
  const model::Law* law = nullptr;
};

Wander wander_of(double length_scale) {
  for (const model::Physics* effect : model::effects())
    for (const model::Law& law : effect->laws)
      if (model::describes_recording(law)) return {effect, &model::law_at(law, length_scale)};
  return {};
}

/// It takes the place of a walk: it follows the time alone, or describes anything.
bool follows_time(const Hypothesis& hypothesis) {
  return !hypothesis.empirical.empty() || std::ranges::any_of(hypothesis.effects, [](const model::Physics* effect) {
    return effect->traits.depends_on.size() == 1 && effect->traits.depends_on.front() == "time";
  });
}

/// Log evidence minus what its effects cost a priori.
double log_posterior(const Hypothesis& hypothesis, const SelectionOptions& options) {
  double cost = 0.0;
  for (const auto* effect : hypothesis.effects) cost += prior_cost(*effect, options);
  return hypothesis.evidence - cost;
}

std::optional<WalkingZero> walk_left_by(const Search& search, const Hypothesis& hypothesis) {
  const Problem& problem = search.instrument_problem();
  const Eigen::VectorXd residual_N = problem.target() - problem.predict(hypothesis.fit.spec);
  return walking_zero(problem.series().front(), residual_N, search.instrument().white_N);
}

struct Found {
  WalkingZero walk;
  double white_N = 0.0;
};

/// In what one of the likeliest explanations leaves that do not follow the time themselves.
std::optional<Found> find_walk(const Search& search, const Selection& selection, const SelectionOptions& options) {
  constexpr std::size_t kLikeliest = 3;
  std::vector<const Hypothesis*> likely;
  for (const Hypothesis& each : selection.pool)
    if (!follows_time(each)) likely.push_back(&each);
  std::ranges::stable_sort(likely, std::greater<>(), [&](const auto* each) { return log_posterior(*each, options); });
  if (likely.size() > kLikeliest) likely.resize(kLikeliest);
  for (const Hypothesis* each : likely)
    if (const auto walk = walk_left_by(search, *each)) return Found{*walk, each->fit.noise.white_N};
  return std::nullopt;
}

NoiseModel noise_of(const Found& found, const Series& series) {
  constexpr double kRecordings = 10.0;
  const double correlation_s = kRecordings * (series.nodes.back().t_s - series.nodes.front().t_s);
  return {found.white_N, std::sqrt(0.5 * found.walk.rate_N2_s * correlation_s), correlation_s};
}

/// Log posterior of the likeliest explanation, among those with `effect` where it is not null.
double likeliest(const Selection& selection, const model::Physics* effect, const SelectionOptions& options) {
  double most = -std::numeric_limits<double>::infinity();
  for (const Hypothesis& each : selection.pool)
    if (effect == nullptr || each.has(*effect)) most = std::max(most, log_posterior(each, options));
  return most;
}

/// More is left than noise and a walk: no walk explains it.
bool leaves_structure(const Selection& selection) {
  const double left = selection.excess[selection.best];
  return !selection.chosen().empirical.empty() ||
         (left > deciding().structure_share * static_cast<double>(selection.chosen().fit.rows) &&
          left > deciding().structure_squares);
}

/// The chosen explanation with the drift. What it leaves and its evidence stay those under the walk, which has no
/// cosines.
Hypothesis with_drift(const Wander& wander, const Search& search, Hypothesis chosen) {
  chosen.effects.push_back(wander.effect);
  sort_as_in_catalogue(chosen.effects);
  const model::Reference& recording = search.instrument_problem().series().front().excitation.reference;
  chosen.fit.spec.parts.push_back(started_part(*wander.effect, *wander.law, 0, recording));
  chosen.fit.spec = chosen.ls_spec = levelled(search, std::move(chosen.fit.spec));
  chosen.fit.noise = search.instrument_problem().estimate_noise(chosen.fit.spec);
  chosen.plain_numbers = false;
  return chosen;
}

/// That the zero walks: by the blocks at rest, and by its size beside the other effects, whose laws are never quite
/// right.
double probability_of(const WalkingZero& walk, double size_of_walk_N, const model::Physics& drift, const Search& search,
                      const Selection& selection, const SelectionOptions& options) {
  const double by_rests = 1.0 / (1.0 + std::exp(prior_cost(drift, options) - walk.log_odds_nats));
  if (selection.chosen().effects.empty()) return by_rests;
  double largest_N = size_N(search, selection.chosen(), selection.nominal());
  for (const auto& [effect, each_N] : selection.size_N) largest_N = std::max(largest_N, each_N);
  return by_rests * significance(search, selection.chosen(), options, size_of_walk_N, largest_N);
}

/// The drift joins every explanation; the chosen one is `with` it. The nominal model stays the first, and has its
/// weight as the explanation by the drift alone.
void join(const model::Physics& drift, const Hypothesis& with, Selection& selection) {
  Hypothesis alone = selection.nominal();
  alone.effects = {&drift};
  for (std::size_t i = 1; i < selection.pool.size(); ++i) {
    selection.pool[i].effects.push_back(&drift);
    sort_as_in_catalogue(selection.pool[i].effects);
  }
  if (selection.best == 0) selection.best = selection.pool.size();
  selection.pool.push_back(std::move(alone));
  selection.weight.push_back(std::exchange(selection.weight[0], 0.0));
  selection.excess.push_back(selection.excess[0]);
  selection.pool[selection.best] = with;
}

}  // namespace

model::ModelSpec levelled(const Search& search, model::ModelSpec spec) {
  const Problem problem(search.instrument_problem().series(), plain(search.instrument()));
  std::vector<bool> were_fixed;
  for (model::Part& part : spec.parts) {
    were_fixed.push_back(part.fixed);
    const bool solved = part.physics == &model::element::constant() || model::describes_recording(*part.law);
    part.fixed = part.fixed || !solved;
  }
  Eigen::VectorXd ignored;
  (void)problem.solve(spec, ignored);
  for (std::size_t i = 0; i < spec.parts.size(); ++i) spec.parts[i].fixed = were_fixed[i];
  return spec;
}

std::optional<BesideAWalk> select_beside_a_walk(const Search& search, const Selection& selection,
                                                const model::ModelSpec& nominal, const SelectionOptions& options) {
  const auto series = search.instrument_problem().series();
  const Wander wander = wander_of(nominal.length_scale);
  if (series.size() != 1 || series.front().noise_reading_s > 0.0) return std::nullopt;
  if (wander.effect == nullptr || search.withholds(*wander.effect)) return std::nullopt;
  const std::optional<Found> found = find_walk(search, selection, options);
  if (!found) return std::nullopt;
  Search beside = search.under(noise_of(*found, series.front()), *wander.effect);
  Selection chosen = select_effects(beside, nominal, options);
  prefer_simpler_laws(chosen, beside);
  if (least_squares_decide(chosen) || leaves_structure(chosen)) return std::nullopt;
  const std::optional<WalkingZero> walk = walk_left_by(beside, chosen.chosen());
  if (!walk) return std::nullopt;
  const double beside_walk = likeliest(chosen, nullptr, options) - prior_cost(*wander.effect, options);
  if (likeliest(selection, wander.effect, options) > beside_walk) return std::nullopt;
  const Hypothesis with = with_drift(wander, beside, chosen.chosen());
  const double size = size_N(beside, with, chosen.chosen());
  const double probability = probability_of(*walk, size, *wander.effect, beside, chosen, options);
  if (probability < kLikelierThanNot) return std::nullopt;
  chosen.size_N[wander.effect] = size;
  chosen.probability[wander.effect] = probability;
  join(*wander.effect, with, chosen);
  // Of a walk alone nothing is in excess beside it; before, the walk was.
  if (chosen.chosen().effects.size() == 1) chosen.excess[0] = std::max(chosen.excess[0], selection.excess[0]);
  return BesideAWalk{*walk, std::move(beside), std::move(chosen)};
}

}  // namespace isorig::identify
