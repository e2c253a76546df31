#include "identify/diagnose/search/published.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/fading.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "identify/diagnose/search/hysteresis.hpp"

namespace isorig::identify {
namespace {

constexpr int kIterations = 15;

/// Weights every bin by its number of rows, not by the number of readings that went into them.
std::vector<Series> with_rows_alike(std::span<const Series> kept) {
  std::vector<Series> out(kept.begin(), kept.end());
  for (Series& each : out)
    for (std::size_t k = 0; k < each.count.size(); ++k)
      if (each.count[k] > 0.0) each.count[k] = static_cast<double>(each.first_row[k + 1] - each.first_row[k]);
  return out;
}

model::ModelSpec learn_from(std::span<const Series> kept, const model::ModelSpec& from, const NoiseModel& noise) {
  const Problem problem(kept, noise);
  model::ModelSpec spec = from;
  if (has_table(spec)) spec = learn_table_again(problem, spec);
  if (tabulates_one_recording(spec)) return spec;
  if (has_relay(spec)) scan_relay(problem, spec);
  return problem.fit(std::move(spec), kIterations).spec;
}

/// Log evidence of the kept bins for `with` over the nominal model, minus the prior cost that a search asks of an
/// effect. If it is negative, a search of these bins would not have found the effects.
double shown_by(std::span<const Series> kept, const model::ModelSpec& with, const model::ModelSpec& nominal,
                const NoiseModel& noise) {
  const SelectionOptions options;
  const Problem problem(kept, noise);
  const Fit without = problem.fit(nominal, kIterations);
  const double n = std::max(static_cast<double>(without.rows), 2.0), left = squares_of(problem, with);
  const double gain = without.chi2 - left;
  if (gain <= 0.0) return gain;
  const double more = static_cast<double>(counted_numbers(with)) - static_cast<double>(counted_numbers(without.spec));
  const double likelihood = 0.5 * gain - deciding().numbers_cost_log_rows * std::max(more, 1.0) * std::log(n);
  const double variance =
      0.5 * options.error_degrees * std::log1p(gain / (std::max(left - n, 0.0) + deciding().chance_squares));
  return std::min(likelihood, variance) - options.prior_cost;
}

}  // namespace

PublishedNominal published_nominal(const Search& search, const Selection& selection,
                                   std::span<const std::vector<bool>> usable, unsigned threads) {
  const Fit& weighed = selection.nominal().fit;
  const auto series = search.instrument_problem().series();
  const NoiseModel noise = plain(search.instrument());
  // Bins, to be quick, from everywhere; then rows, since that is what a prediction is measured by.
  const Fit near = fit_from_many_starts(Problem(series, noise), weighed.spec, threads);
  std::vector<Series> rows;
  for (std::size_t i = 0; i < series.size(); ++i)
    rows.push_back(by_rows(series[i], i < usable.size() ? usable[i] : std::vector<bool>{}));
  const Problem by_row(rows, noise);
  const Fit least = by_row.fit(near.spec, kIterations);
  if (squares_of(by_row, weighed.spec) <= deciding().plain_fit_squares_ratio * least.chi2)
    return {weighed, {weighed.noise, false}};
  PublishedNominal out{near, {noise, true}};
  out.fit.spec = least.spec;
  out.fit.stop = least.stop;
  return out;
}

bool errs_more_than_noise(const Hypothesis& hypothesis) {
  return hypothesis.ls_chi2 > deciding().error_rules_squares * static_cast<double>(hypothesis.fit.rows);
}

bool least_squares_decide(const Selection& selection) {
  return selection.error_rules || selection.noise_scale > deciding().least_squares_noise_scale ||
         errs_more_than_noise(selection.chosen()) || selection.chosen().plain_numbers;
}

Criterion criterion_of_chosen(const Search& search, const Selection& selection) {
  if (least_squares_decide(selection)) return {plain(search.instrument()), false};
  return {selection.chosen().empirical.empty() ? selection.chosen().fit.noise : search.instrument(), false};
}

Learner learn_again(model::ModelSpec spec, Criterion criterion) {
  for (model::Part& part : spec.parts) part.fixed = part.fixed || is_state(part);
  return [spec = std::move(spec), criterion](std::span<const Series> kept) {
    if (!criterion.rows_alike) return learn_from(kept, spec, criterion.noise);
    const std::vector<Series> rows = with_rows_alike(kept);
    return learn_from(rows, spec, criterion.noise);
  };
}

Learner learn_again_if_shown(model::ModelSpec spec, Criterion criterion, const model::ModelSpec& nominal,
                             Criterion nominal_criterion) {
  return [learn = learn_again(std::move(spec), criterion), learn_nominal = learn_again(nominal, nominal_criterion),
          nominal, noise = criterion.noise](std::span<const Series> kept) {
    model::ModelSpec with = learn(kept), without = learn_nominal(kept);
    if (shown_by(kept, with, nominal, noise) <= 0.0) return without;
    with.seen = ranges_of(kept);
    with.seen->nominal = std::move(without.parts);
    return with;
  };
}

}  // namespace isorig::identify
