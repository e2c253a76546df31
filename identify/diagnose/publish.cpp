#include "identify/diagnose/publish.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "identify/diagnose/explain/passivity.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

/// Within a thousandth of the range, as it is searched. The bound may be the law's own limit, documented as such; and
/// zero of a number that is searched on a linear scale means that the law is the simpler one.
bool at_wrong_bound(const model::Parameter& parameter, double value) {
  constexpr double kNear = 1e-3;
  if (parameter.traits.event_time || parameter.traits.initial_state ||
      parameter.traits.filled_by != model::FilledBy::kNothing)
    return false;
  const double low = to_search(parameter, parameter.lower), high = to_search(parameter, parameter.upper);
  const double share = (to_search(parameter, value) - low) / (high - low);
  const bool zero = !parameter.logarithmic && parameter.lower == 0.0;
  if (share < kNear) return parameter.traits.lower_limit_law.empty() && !zero;
  return share > 1.0 - kNear && parameter.traits.upper_limit_law.empty();
}

/// Of `whole` without one thing, refitted as the chosen explanation was.
Candidate settled(const Search& search, const Selection& selection, Hypothesis smaller) {
  search.settle(smaller, true);
  const bool plain_fit = least_squares_decide(selection);
  if (plain_fit)
    smaller.fit = Problem(search.instrument_problem().series(), plain(search.instrument())).fit(smaller.fit.spec, 30);
  const NoiseModel noise = plain_fit                   ? plain(search.instrument())
                           : smaller.empirical.empty() ? smaller.fit.noise
                                                       : search.instrument();
  return {std::move(smaller.fit.spec), {noise, false}, std::move(smaller.effects), std::move(smaller.empirical)};
}

/// The next smaller candidate; nothing below a single effect.
std::optional<Candidate> smaller(const Search& search, const Selection& selection, const Candidate& from) {
  Hypothesis rest;
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

std::string text_of(const LeftOut& row) {
  char text[240];
  const std::string what = row.by == "block" ? "a quarter of the recording" : row.by + " " + row.value;
  std::snprintf(text, sizeof text, "where %s is left out it errs by %.3g N rms, the nominal model by %.3g N",
                what.c_str(), row.model_rmse_N, row.nominal_rmse_N);
  return text;
}

}  // namespace

bool worse(const LeftOut& row, double noise_N) {
  constexpr double kNoises = 0.3, kErrors = 2.0, kFewRatio = 1.1, kAnyRatio = 2.0;
  constexpr std::size_t kFewestStrokes = 4;
  if (row.more_N2 <= kNoises * kNoises * noise_N * noise_N * row.readings) return false;
  if (row.model_rmse_N > kAnyRatio * row.nominal_rmse_N) return true;
  if (row.strokes < kFewestStrokes) return row.model_rmse_N > kFewRatio * row.nominal_rmse_N;
  return row.more_N2 > kErrors * row.more_error_N2;
}

std::string unphysical(const model::ModelSpec& spec, std::span<const Series> series, double noise_N) {
  char text[240];
  for (const model::Part& part : spec.parts) {
    if (!model::is_effect(*part.physics) && !model::is_empirical(*part.physics)) continue;
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const model::Parameter& parameter = part.law->parameters[i];
      if (!at_wrong_bound(parameter, part.parameters[i])) continue;
      std::snprintf(text, sizeof text, "%s of %s stands at the end of its range (%.4g)", parameter.name.data(),
                    part.physics->name.data(), part.parameters[i]);
      return text;
    }
  }
  if (const auto loop = active_loop(spec, series, noise_N)) {
    std::snprintf(text, sizeof text,
                  "on a loop of +-%.3g mm about %.3g mm at %.3g mm/s it would give out %.3g N mm of work a turn, which "
                  "no specimen does",
                  loop->amplitude_mm, loop->centre_mm, loop->fastest_mm_s, -loop->work_N_mm);
    return text;
  }
  return {};
}

Publication publish(const Search& search, const Selection& selection, const LeaveOut& leave_out, Candidate whole,
                    const Candidate& nominal, double noise_N) {
  Publication out;
  std::optional<Candidate> candidate;
  if (!whole.effects.empty() || !whole.described_by.empty()) candidate = whole;
  for (; candidate; candidate = smaller(search, selection, *candidate)) {
    std::string why = unphysical(candidate->spec, search.instrument_problem().series(), noise_N);
    std::optional<LeftOut> decided_by;
    if (why.empty()) {
      HeldoutStudy study = leave_out.study(candidate->spec, learn_again_if_shown(candidate->spec, candidate->criterion,
                                                                                 nominal.spec, nominal.criterion));
      std::vector<LeftOut> rows = study.left_out;
      if (study.all) rows.push_back(*study.all);
      const auto found = std::ranges::find_if(rows, [&](const LeftOut& row) { return worse(row, noise_N); });
      if (found == rows.end()) {
        out.heldout = std::move(study);
        break;
      }
      decided_by = *found;
      why = text_of(*found);
    }
    if (!out.why.empty()) continue;
    out.why = std::move(why);
    out.decided_by = std::move(decided_by);
  }
  if (!candidate) {
    candidate = nominal;
    out.heldout = leave_out.study_of_nominal(nominal.spec);
  }
  for (const auto* effect : selection.chosen().effects)
    if (std::ranges::find(candidate->effects, effect) == candidate->effects.end())
      out.located_only.emplace_back(effect->name);
  if (candidate->described_by != whole.described_by) out.located_only.push_back(whole.described_by);
  // A memory that was found beside the nominal model and not beside the effects: they are named and not modelled.
  if (out.why.empty() && !out.located_only.empty())
    out.why = "a memory of the recording (" + candidate->described_by + ") stands in their place";
  out.model = std::move(*candidate);
  return out;
}

}  // namespace isorig::identify
