#include "identify/diagnose/publish.hpp"

#include <algorithm>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/explain/passivity.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/noise/walking_zero.hpp"
#include "identify/diagnose/search/beside_a_walk.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "model/catalogue.hpp"
#include "model/number_sheet.hpp"
#include "model/words.hpp"

namespace isorig::identify {

namespace {

/// `whole` without one effect or without its table, refitted as the chosen explanation was.
Candidate settled(const Search& search, const Selection& selection, Hypothesis smaller) {
  search.settle(smaller, true);
  const bool plain_fit = least_squares_decide(selection);
  if (plain_fit)
    smaller.fit = Problem(search.instrument_problem().series(), plain(search.instrument())).fit(smaller.fit.spec, 30);
  const NoiseModel noise = plain_fit                   ? plain(search.instrument())
                           : smaller.empirical.empty() ? smaller.fit.noise
                                                       : search.instrument();
  model::ModelSpec spec = is_walk(search.instrument(), search.instrument_problem().series())
                              ? levelled(search, std::move(smaller.fit.spec))
                              : std::move(smaller.fit.spec);
  return {std::move(spec), {noise, false}, std::move(smaller.effects), std::move(smaller.empirical)};
}

/// The next smaller candidate; nothing below a single effect.
std::optional<Candidate> smaller(const Search& search, const Selection& selection, const Candidate& from) {
  Hypothesis rest;
  rest.nominal_arms = selection.nominal().nominal_arms;
  rest.effects = from.effects;
  if (!from.described_by.empty()) {
    const Hypothesis& chosen = selection.chosen();
    const bool memory_was_on_top = from.described_by != chosen.empirical;
    if (memory_was_on_top && (!chosen.effects.empty() || !chosen.empirical.empty()))
      return Candidate{chosen.fit.spec, criterion_of_chosen(search, selection), chosen.effects, chosen.empirical};
    if (from.effects.empty()) return std::nullopt;
    rest.fit.spec = from.spec;
    std::erase_if(rest.fit.spec.parts, [](const model::Part& part) { return model::is_empirical(*part.physics); });
    rest.fit = search.fit_from(rest.fit.spec, 25);
    return settled(search, selection, std::move(rest));
  }
  if (from.effects.size() < 2) return std::nullopt;
  const auto size = [&](const model::Physics* effect) {
    const auto found = selection.size_N.find(effect);
    return found == selection.size_N.end() ? 0.0 : found->second;
  };
  const model::Physics* weakest = *std::ranges::min_element(from.effects, {}, size);
  rest.fit.spec = from.spec;
  return settled(search, selection, search.without(rest, *weakest));
}

/// The effects of a candidate that are doubted and that no left-out reading tests.
std::vector<const model::Physics*> untested_of(const Candidate& candidate,
                                               const std::vector<const model::Physics*>& doubted) {
  std::vector<const model::Physics*> found;
  for (const auto* effect : candidate.effects) {
    const bool has_state = std::ranges::any_of(
        candidate.spec.parts, [&](const model::Part& part) { return part.physics == effect && is_state(part); });
    if (has_state && std::ranges::find(doubted, effect) != doubted.end()) found.push_back(effect);
  }
  return found;
}

/// Without those effects, and without the table or memory that was found beside them. Nothing where no effect is left.
std::optional<Candidate> tested(const Search& search, const Selection& selection, Candidate from,
                                const std::vector<const model::Physics*>& untested) {
  while (!from.described_by.empty()) {
    auto without_table = smaller(search, selection, from);
    if (!without_table) return std::nullopt;
    from = std::move(*without_table);
  }
  Hypothesis rest;
  rest.nominal_arms = selection.nominal().nominal_arms;
  rest.effects = from.effects;
  rest.fit.spec = from.spec;
  for (const auto* effect : untested) rest = search.without(rest, *effect);
  if (rest.effects.empty()) return std::nullopt;
  return settled(search, selection, std::move(rest));
}

/// rms of a single reading, over all of them (Prediction::rmse_N).
double rms_of_all_N(const Problem& problem, const model::ModelSpec& spec, double white_N) {
  const Eigen::VectorXd error_N = problem.target() - problem.predict(spec);
  Prediction all;
  Eigen::Index row = 0;
  for (const Series& each : problem.series()) {
    for (const double readings : each.count) {
      all.squares_N2 += readings * error_N[row] * error_N[row];
      all.readings += readings;
      all.bins += readings > 0.0 ? 1.0 : 0.0;
      ++row;
    }
  }
  return all.rmse_N(white_N);
}

/// The candidate errs more than the nominal model over what it was fitted to: a fit under coloured noise gives up the
/// force for its differences, and where no part of the recording shows the effect alone nothing left out tells. Not
/// asked beside a zero that walks: least squares over the readings follow the walk, so that the nominal model's small
/// error is that of wrong numbers.
std::string worse_where_fitted(double model_N, double nominal_N, double noise_N) {
  const double noises = deciding().worse_noises;
  if (model_N * model_N <= nominal_N * nominal_N + noises * noises * noise_N * noise_N) return {};
  return base::formatted("over all that it was fitted to it errs by %.3g N rms, the nominal model by %.3g N", model_N,
                         nominal_N);
}

std::string text_of(const LeftOut& row) {
  const std::string what = row.by == "block" ? "a quarter of the recording" : row.by + " " + row.value;
  return base::formatted("where %s is left out it errs by %.3g N rms, the nominal model by %.3g N", what.c_str(),
                         row.model_rmse_N, row.nominal_rmse_N);
}

}  // namespace

bool worse(const LeftOut& row, double noise_N) {
  const double noises = deciding().worse_noises;
  if (row.more_N2 <= noises * noises * noise_N * noise_N * row.readings) return false;
  if (row.model_rmse_N > deciding().worse_ratio_at_any_rate * row.nominal_rmse_N) return true;
  // The numbers are noisy, and all strokes that are left out share them: how the strokes disagree does not show it. A
  // quadratic form of normal deviates with the mean T exceeds 3.84 T in at most 5 % of all cases, whatever its weights:
  // the largest tail is that of a single one (Szekely & Bakirov 2003, Probab. Theory Relat. Fields 126, 184).
  if (row.more_N2 <= deciding().learning_noise_quantile * row.learning_N2) return false;
  if (row.strokes < deciding().fewest_strokes_to_compare)
    return row.model_rmse_N > deciding().worse_ratio_of_few_strokes * row.nominal_rmse_N;
  return row.more_N2 > deciding().worse_standard_errors * row.more_error_N2;
}

std::string shown_too_seldom(const HeldoutStudy& study) {
  const auto not_shown = static_cast<std::size_t>(std::ranges::count(study.left_out, 0.0, &LeftOut::more_N2));
  constexpr std::size_t kOneOf = 4;
  if (kOneOf * not_shown <= study.left_out.size()) return {};
  return base::formatted(
      "where one motion or recording at a time is left out, the others do not show it in %zu of %zu cases", not_shown,
      study.left_out.size());
}

std::string unphysical(const model::ModelSpec& spec, std::span<const Series> series, double noise_N) {
  for (const model::Part& part : spec.parts) {
    if (!model::is_effect(*part.physics) && !model::is_empirical(*part.physics)) continue;
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const model::Parameter& parameter = part.law->parameters[i];
      if (!at_wrong_bound(parameter, part.parameters[i])) continue;
      std::string what = model::meaning_of(&parameter.sheet);
      if (what.empty()) what = "a number";
      return base::formatted("%s [%s] of %s stands at the end of its range, %.4g%s", what.c_str(),
                             parameter.name.data(), model::effect_words(part.physics->name).c_str(), part.parameters[i],
                             model::unit_behind(&parameter.sheet).c_str());
    }
  }
  if (const auto loop = active_loop(spec, series, noise_N))
    return base::formatted(
        "on a loop of +-%.3g mm about %.3g mm at %.3g mm/s it would give out %.3g N mm of work a turn, which "
        "no specimen does",
        loop->amplitude_mm, loop->centre_mm, loop->fastest_mm_s, -loop->work_N_mm);
  return {};
}

/// A model that passed, at the largest share at which it does.
struct Passed {
  Candidate candidate;
  HeldoutStudy study;
  double share = 1.0;
  std::string why_share;

  /// Squares that the model leaves more than the nominal one, over everything that was left out.
  [[nodiscard]] double more_N2() const {
    double sum = study.all ? study.all->more_N2 : 0.0;
    for (const LeftOut& row : study.left_out) sum += row.more_N2;
    return sum;
  }
};

/// The candidate at the largest share at which nothing left out is predicted worse; nothing below the least share.
/// `against`: the row that spoke against all of it.
std::optional<Passed> at_largest_share(const LeaveOut& leave_out, const Candidate& candidate, const Candidate& nominal,
                                       bool only_noise, double noise_N, std::optional<LeftOut>& against) {
  constexpr int kSteps = 10;
  const LeaveOut::Predictions predictions =
      leave_out.predict(learn_again_if_shown(candidate.spec, candidate.criterion, nominal.spec, nominal.criterion),
                        candidate.criterion.noise);
  for (int step = kSteps; step > 0; --step) {
    const double share = static_cast<double>(step) / kSteps;
    if (share < deciding().least_share) return std::nullopt;
    HeldoutStudy study = leave_out.study(candidate.spec, predictions, share);
    std::vector<LeftOut> rows = study.left_out;
    if (study.all) rows.push_back(*study.all);
    // A covariance that takes up an error of the model says nothing about noise in its numbers.
    if (!only_noise)
      for (LeftOut& row : rows) row.learning_N2 = 0.0;
    const auto found = std::ranges::find_if(rows, [&](const LeftOut& row) { return worse(row, noise_N); });
    if (found == rows.end()) return Passed{candidate, std::move(study), share, against ? text_of(*against) : ""};
    if (!against) against = *found;
  }
  return std::nullopt;
}

Publication publish(const Search& search, const Selection& selection, const LeaveOut& leave_out, const Candidate& whole,
                    const Candidate& nominal, double noise_N, const std::vector<const model::Physics*>& doubted) {
  Publication out;
  std::optional<Candidate> candidate;
  if (!whole.effects.empty() || !whole.described_by.empty()) candidate = whole;
  if (candidate) {
    if (const auto untested = untested_of(*candidate, doubted); !untested.empty()) {
      out.why = base::formatted("no reading that is left out tests %s, and it is stated with less than 0.5",
                                model::effect_words(untested.front()->name).c_str());
      candidate = tested(search, selection, std::move(*candidate), untested);
    }
  }
  const Problem& problem = search.instrument_problem();
  const double white_N = search.instrument().white_N;
  const double nominal_N = rms_of_all_N(problem, nominal.spec, white_N);
  const bool beside_a_walk = is_walk(search.instrument(), problem.series());
  std::optional<Passed> passed;
  for (; candidate; candidate = smaller(search, selection, *candidate)) {
    std::string why = unphysical(candidate->spec, problem.series(), noise_N);
    std::optional<LeftOut> decided_by;
    const double model_N = rms_of_all_N(problem, candidate->spec, white_N);
    const bool not_sure =
        !candidate->described_by.empty() || std::ranges::all_of(candidate->effects, [&](const auto* e) {
          return std::ranges::find(doubted, e) != doubted.end();
        });
    if (why.empty() && !beside_a_walk) why = worse_where_fitted(model_N, nominal_N, noise_N);
    if (why.empty()) {
      auto found = at_largest_share(leave_out, *candidate, nominal, model_N <= deciding().only_noise_ratio * noise_N,
                                    noise_N, decided_by);
      if (found && not_sure) why = shown_too_seldom(found->study);
      if (!why.empty()) {
        found.reset();
        decided_by.reset();
      }
      const bool all_of_it = found && found->share == 1.0;
      if (found && (!passed || found->more_N2() < passed->more_N2())) passed = std::move(found);
      if (all_of_it) break;
      if (why.empty()) why = text_of(*decided_by);
    }
    if (!out.why.empty()) continue;
    out.why = std::move(why);
    out.decided_by = std::move(decided_by);
  }
  if (passed) {
    candidate = std::move(passed->candidate);
  } else {
    candidate = nominal;
  }
  out.heldout = passed ? std::move(passed->study) : leave_out.study_of_nominal(nominal.spec);
  if (passed) {
    out.share = passed->share;
    out.why_share = std::move(passed->why_share);
  }
  for (const auto* effect : selection.chosen().effects)
    if (std::ranges::find(candidate->effects, effect) == candidate->effects.end())
      out.located_only.emplace_back(effect->name);
  if (candidate->described_by != whole.described_by) out.located_only.push_back(whole.described_by);
  // A share of everything that was found: nothing is without a model, and what spoke against all of it is why_share.
  if (out.located_only.empty()) {
    out.why.clear();
    out.decided_by.reset();
  }
  // A memory or product that was found beside the nominal model and not beside the effects: they are named and not
  // modelled.
  if (out.why.empty() && !out.located_only.empty())
    out.why = "what has no name (" + candidate->described_by + ") stands in their place";
  out.model = std::move(*candidate);
  return out;
}

}  // namespace isorig::identify
