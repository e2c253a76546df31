#include "identify/diagnose/search/repeated_evidence.hpp"

#include <algorithm>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <set>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/blocks.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "identify/diagnose/search/published.hpp"
#include "identify/diagnose/search/without_effect.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

struct Statistic {
  double t = 0.0;
  double degrees_of_freedom = 0.0;
};

std::optional<Statistic> t_of(const Eigen::VectorXd& change, const Eigen::VectorXd& left,
                              const std::vector<std::size_t>& block_of_bin, std::size_t count) {
  if (count < deciding().fewest_blocks_to_agree) return std::nullopt;
  const double power = change.squaredNorm(), beyond = change.dot(left) / power;
  std::vector<double> wanted(count, 0.0);
  for (std::size_t bin = 0; bin < block_of_bin.size(); ++bin) {
    const auto row = static_cast<Eigen::Index>(bin);
    wanted[block_of_bin[bin]] += change[row] * (left[row] - beyond * change[row]);
  }
  double squares = 0.0;
  for (const double each : wanted) squares += each * each;
  const auto blocks = static_cast<double>(count);
  const double error = std::sqrt(blocks / (blocks - 1.0) * squares);
  return Statistic{(1.0 + beyond) * power / std::max(error, 1e-300), blocks - 1.0};
}

/// The deviate of the standard normal distribution that is as improbable as `statistic`, one-sided.
double normal_deviate(const Statistic& statistic) {
  constexpr double kLargest = 37.0;  // beyond it the probability is no double
  if (statistic.t <= 0.0) return 0.0;
  const double beyond = cdf(complement(boost::math::students_t(statistic.degrees_of_freedom), statistic.t));
  if (beyond <= 1e-300) return kLargest;
  return std::max(quantile(complement(boost::math::normal(), std::min(beyond, 0.5))), 0.0);
}

/// Of the sets that contain the one at `chosen` and leave far less, the one that leaves least.
std::optional<std::size_t> larger_set_that_leaves_less(const Selection& selection, std::size_t chosen) {
  std::optional<std::size_t> out;
  double least = deciding().leaves_less_share * selection.pool[chosen].ls_chi2;
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& larger = selection.pool[i];
    if (!larger.empirical.empty() || larger.effects.size() <= selection.pool[chosen].effects.size()) continue;
    const auto has = [&](const model::Physics* effect) { return larger.has(*effect); };
    if (larger.ls_chi2 >= least || !std::ranges::all_of(selection.pool[chosen].effects, has)) continue;
    least = larger.ls_chi2;
    out = i;
  }
  return out;
}

/// How much the strokes agree on an effect of the set at `with`.
std::optional<double> agreement_in(Selection& selection, const Search& search, std::size_t with,
                                   const model::Physics& effect) {
  const std::size_t rest = without_effect(selection, search, with, effect);
  const NoiseModel noise =
      least_squares_decide(selection) ? plain(search.instrument()) : selection.pool[with].fit.noise;
  return agreement(search, selection.pool[with], selection.pool[rest], noise);
}

}  // namespace

std::optional<double> agreement(const Search& search, const Hypothesis& with, const Hypothesis& without,
                                const NoiseModel& noise) {
  const Problem problem(search.instrument_problem().series(), noise);
  const Eigen::VectorXd predicted = problem.predict(with.fit.spec);
  RowMatrix both(predicted.size(), 2);
  both.col(0) = predicted - problem.predict(without.fit.spec);
  both.col(1) = problem.target() - predicted;
  (void)whiten(problem.series(), problem.noise(), both);
  const Eigen::VectorXd change = both.col(0), left = both.col(1);
  if (change.squaredNorm() <= 0.0) return 0.0;
  const Blocks strokes = strokes_of(problem.series());
  const MoveNumbers moves = number_moves(problem.series());
  std::optional<double> least;
  for (const auto& statistic :
       {t_of(change, left, strokes.of_bin, strokes.count), t_of(change, left, moves.of_bin, moves.count)}) {
    if (!statistic) continue;
    const double z = normal_deviate(*statistic);
    least = least ? std::min(*least, z) : z;
  }
  return least;
}

double prior_cost(const model::Physics& effect, const SelectionOptions& options) {
  return options.prior_cost + (effect.traits.unusual ? options.unusual_cost : 0.0) +
         (effect.traits.contains.empty() ? 0.0 : options.contains_cost);
}

void discount_unrepeated_effects(Selection& selection, const Search& search, const SelectionOptions& options) {
  constexpr int kRounds = 4;
  const double looks = std::log(static_cast<double>(model::effects().size()));
  std::set<const model::Physics*> done;
  for (int round = 0; round < kRounds; ++round) {
    bool moved = false;
    const std::size_t chosen = selection.best;
    const auto effects = selection.pool[chosen].effects;
    for (const auto* effect : effects) {
      if (is_refined(selection.pool[chosen], *effect) || !done.insert(effect).second) continue;
      std::optional<double> z = agreement_in(selection, search, chosen, *effect);
      if (!z) continue;
      const auto odds = [&] { return 0.5 * *z * *z - prior_cost(*effect, options) - looks; };
      // What a set leaves is the noise that its effects are judged in. Where a larger set leaves far less, most of that
      // is known to be something else.
      if (odds() <= deciding().sure_log_odds_nats)
        if (const auto larger = larger_set_that_leaves_less(selection, chosen))
          z = std::max(*z, agreement_in(selection, search, *larger, *effect).value_or(0.0));
      const double log_odds = odds();
      if (log_odds > deciding().sure_log_odds_nats) continue;
      moved = move_weight(selection, search, *effect, 1.0 / (1.0 + std::exp(-log_odds)), true) || moved;
    }
    if (!moved) break;
    count_weights(selection);
  }
}

}  // namespace isorig::identify
