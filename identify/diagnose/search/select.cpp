#include "identify/diagnose/search/select.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/noise/effective_dof.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "identify/diagnose/search/practical_significance.hpp"
#include "identify/diagnose/search/repeated_evidence.hpp"

namespace isorig::identify {
namespace {

void add(std::vector<Hypothesis>& pool, std::vector<Hypothesis> more) {
  for (Hypothesis& hypothesis : more) {
    count_arms(hypothesis);
    const auto same = std::ranges::find_if(pool, [&](const Hypothesis& h) {
      return h.effects == hypothesis.effects && h.empirical == hypothesis.empirical;
    });
    if (same == pool.end())
      pool.push_back(std::move(hypothesis));
    else if (hypothesis.evidence > same->evidence)
      *same = std::move(hypothesis);
  }
}

std::vector<std::size_t> ranked(const std::vector<Hypothesis>& pool, std::size_t size) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < pool.size(); ++i)
    if (pool[i].effects.size() == size) order.push_back(i);
  std::ranges::sort(order, std::greater<>(), [&](std::size_t i) { return pool[i].evidence; });
  return order;
}

std::size_t events(const Hypothesis& hypothesis, const model::Physics& effect) {
  return static_cast<std::size_t>(std::ranges::count_if(hypothesis.fit.spec.parts, [&](const model::Part& part) {
    return part.physics == &effect && model::is_event(*part.law);
  }));
}

double block_median(const Eigen::VectorXd& residual) {
  const auto blocks = static_cast<std::size_t>(deciding().noise_scale_blocks);
  // A bin without readings has no weight and leaves exactly nothing: of a channel that died half-way the median block
  // would be one of its end.
  std::vector<double> squares;
  for (const double r : residual)
    if (r != 0.0) squares.push_back(r * r);
  if (squares.empty()) return 0.0;
  std::vector<double> means;
  for (std::size_t b = 0; b < blocks; ++b) {
    const std::size_t from = squares.size() * b / blocks, to = squares.size() * (b + 1) / blocks;
    if (to == from) continue;
    const auto at = squares.begin();
    means.push_back(std::accumulate(at + static_cast<std::ptrdiff_t>(from), at + static_cast<std::ptrdiff_t>(to), 0.0) /
                    static_cast<double>(to - from));
  }
  return base::quantile(std::move(means), 0.5);
}

}  // namespace

void weigh(Selection& selection, const Search& search, const SelectionOptions& options) {
  const auto& pool = selection.pool;
  std::vector<double> cost(pool.size(), 0.0);
  for (std::size_t i = 0; i < pool.size(); ++i) {
    // Each event as often as it happens: that a grip slips eight times is as rare as eight effects.
    for (const auto* effect : pool[i].effects)
      cost[i] += prior_cost(*effect, options) * static_cast<double>(std::max<std::size_t>(events(pool[i], *effect), 1));
  }
  for (std::size_t i = 0; i < pool.size(); ++i)
    if (!pool[i].empirical.empty()) cost[i] += options.unknown_cost;
  std::size_t top = 0;
  for (std::size_t i = 1; i < pool.size(); ++i)
    if (pool[i].evidence - cost[i] > pool[top].evidence - cost[top]) top = i;
  // Without rests and with residuals of many noises, a likelihood compares how the laws err at reversals and corners,
  // not which is nearer: then the variances are compared (error_rules).
  const auto error = [&](std::size_t i) {
    return 0.5 * options.error_degrees * std::log(std::max(pool[i].ls_chi2, 1e-300)) + cost[i];
  };
  std::size_t least = 0;
  for (std::size_t i = 1; i < pool.size(); ++i)
    if (error(i) < error(least)) least = i;
  selection.error_rules =
      options.count_independent_errors && std::isfinite(options.most_noise_scale) &&
      pool[least].ls_chi2 > deciding().error_rules_squares * static_cast<double>(pool[least].fit.rows);
  if (selection.error_rules) top = least;

  // The excess of each explanation: its whitened squares minus those of noise alone. The scale of that noise is the
  // median power of the blocks of the best explanation: where half of the recording is fitted well, the rest of it does
  // not raise the scale.
  Eigen::VectorXd residual;
  model::ModelSpec spec = pool[top].fit.spec;
  (void)search.instrument_problem().solve(spec, residual);
  // An explanation with a number for every row leaves nothing, and no scale: squares are compared with rounding then.
  constexpr double kRounding = 1e-12;
  selection.noise_scale =
      std::clamp(std::max(block_median(residual), kRounding), options.least_noise_scale, options.most_noise_scale);
  const double noise = selection.noise_scale * static_cast<double>(pool[top].fit.rows);
  selection.excess.assign(pool.size(), 0.0);
  for (std::size_t i = 0; i < pool.size(); ++i)
    selection.excess[i] = std::max(pool[i].ls_chi2 - noise, 0.0) / selection.noise_scale;

  // Variances are compared with the explanation that leaves least: beside the most likely one, which may leave much and
  // err smoothly, all that leave less would look alike.
  std::size_t nearest = top;
  const bool chance = !selection.error_rules && selection.excess[top] <= deciding().chance_squares;
  if (!selection.error_rules && !chance)
    for (std::size_t i = 0; i < pool.size(); ++i)
      if (pool[i].ls_chi2 < pool[nearest].ls_chi2) nearest = i;

  double degrees = options.error_degrees;
  if (options.count_independent_errors)
    degrees = std::max(degrees, effective_degrees_of_freedom(search.instrument_problem().series(), residual));
  std::vector<double> log_weight(pool.size());
  for (std::size_t i = 0; i < pool.size(); ++i) {
    const double likelihood = std::max(pool[top].evidence - pool[i].evidence, 0.0);
    // Not the clipped excesses: below the noise, too, less left is better.
    const double more = (pool[i].ls_chi2 - pool[nearest].ls_chi2) / selection.noise_scale;
    const double left = selection.error_rules ? more : std::max(more, 0.0);
    const double variance = 0.5 * degrees * std::log1p(left / (selection.excess[nearest] + deciding().chance_squares));
    // Where the most likely explanation leaves no more than chance, one that leaves less is not better for that.
    const bool by_chance = chance && more < 0.0;
    const double worse = selection.error_rules ? variance : by_chance ? likelihood : std::min(likelihood, variance);
    log_weight[i] = -worse - cost[i];
  }
  const double most = *std::ranges::max_element(log_weight);
  double sum = 0.0;
  selection.weight.assign(pool.size(), 0.0);
  for (std::size_t i = 0; i < pool.size(); ++i) sum += selection.weight[i] = std::exp(log_weight[i] - most);
  selection.best = 0;
  selection.probability.clear();
  for (double& weight : selection.weight) weight /= sum;
  selection.weighed = selection.weight;
  for (std::size_t i = 0; i < pool.size(); ++i) {
    if (selection.weight[i] > selection.weight[selection.best]) selection.best = i;
    for (const auto* effect : pool[i].effects) selection.probability[effect] += selection.weight[i];
  }
  // Sums of rounded weights: a probability stays one.
  for (auto& [effect, probability] : selection.probability) probability = std::min(probability, 1.0);
}

Selection select_effects(const Search& search, const model::ModelSpec& nominal, const SelectionOptions& options) {
  const auto now = [&](double fraction) {
    if (options.on_progress) options.on_progress(fraction);
  };
  Selection selection;
  auto& pool = selection.pool;
  pool.push_back(search.nominal(nominal));
  now(0.05);
  add(pool, search.extend(pool.front(), 5, true));
  double best = pool.front().evidence, least = pool.front().ls_chi2;
  // Of as many effects, the explanation that leaves least. Where the laws err by far more than the noise, the most
  // likely one may leave ten times as much: it errs more smoothly.
  const auto nearest = [&](const std::vector<std::size_t>& of) {
    return *std::ranges::min_element(of, {}, [&](std::size_t i) { return pool[i].ls_chi2; });
  };
  const auto explains_more = [&](const std::vector<std::size_t>& of) {
    return !of.empty() && (pool[of.front()].evidence >= best + options.least_gain ||
                           pool[nearest(of)].ls_chi2 < deciding().leaves_less_share * least);
  };
  for (std::size_t size = 1; size < options.most_effects; ++size) {
    now(size == 1 ? 0.35 : 0.7);
    auto order = ranked(pool, size);
    if (!explains_more(order)) break;
    if (size > 1) {
      pool[order[0]] = search.with_other_laws(pool[order[0]]);
      order = ranked(pool, size);
    }
    const std::size_t near = nearest(order);
    const bool nearer = pool[near].ls_chi2 < deciding().leaves_less_share * pool[order[0]].ls_chi2;
    best = std::max(best, pool[order.front()].evidence);
    least = std::min(least, pool[near].ls_chi2);
    add(pool, search.extend(pool[order[0]], 3, false));
    if (nearer) add(pool, search.extend(pool[near], 3, false));
    // More of the beam only where one more effect explains more at all.
    if (!explains_more(ranked(pool, size + 1))) break;
    // If the first effect explains all but 2 % of the nominal model's squares, every explanation has it. Else the next
    // best single effects are extended, too: the best pair need not contain the best single.
    if (size == 1 && pool[order.front()].ls_chi2 < deciding().single_settles_share * pool.front().ls_chi2) continue;
    for (std::size_t b = 1; b < std::min<std::size_t>(order.size(), size == 1 ? 4 : 2); ++b) {
      if (nearer && order[b] == near) continue;
      const Hypothesis base = pool[order[b]];
      add(pool, search.extend(base, 2, false));
      now((size == 1 ? 0.45 : 0.7) + 0.08 * static_cast<double>(b));
    }
  }
  now(0.8);
  weigh(selection, search, options);

  // Where the best set has a large excess, a table of one variable is tried, beside the nominal model and beside that
  // set; then all are weighed again.
  const double rows = static_cast<double>(selection.nominal().fit.rows);
  if (selection.excess[selection.best] >
      std::max(deciding().table_excess_share * rows, deciding().table_excess_squares)) {
    std::vector<Hypothesis> described;
    if (auto plain = describe_unknown(search, selection.nominal())) described.push_back(std::move(*plain));
    if (selection.best != 0)
      if (auto more = describe_unknown(search, selection.chosen())) described.push_back(std::move(*more));
    for (Hypothesis& hypothesis : described) pool.push_back(std::move(hypothesis));
    weigh(selection, search, options);
  }
  now(0.9);
  discount_unrepeated_effects(selection, search, options);
  discount_insignificant_effects(selection, search, options);
  return selection;
}

}  // namespace isorig::identify
