#include "identify/diagnose/search/hypothesis.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/fit/merged_bins.hpp"
#include "identify/diagnose/search/events.hpp"
#include "identify/diagnose/search/physical_size.hpp"
#include "identify/diagnose/search/resolution.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Part;

constexpr int kScreenSteps = 2;

bool takes_rest_length(const model::Law& law) {
  return std::ranges::any_of(law.parameters, [](const model::Parameter& parameter) {
    return parameter.traits.filled_by == model::FilledBy::kRestLength;
  });
}

struct Range {
  double low = 1e300, high = -1e300;
};

Range pressure_range(std::span<const Series> series) {
  Range out;
  for (const Series& each : series) {
    for (const double p : each.excitation.pressure_psi) {
      out.low = std::min(out.low, p);
      out.high = std::max(out.high, p);
    }
  }
  return out;
}

/// The pressure varies by enough to tell a force that grows with it from a force that is the same at every pressure.
bool pressure_varies(std::span<const Series> series) {
  const auto [low, high] = pressure_range(series);
  return high - low > deciding().pressure_varies_share * std::max(std::fabs(high), std::fabs(low));
}

bool pressure_is_still(std::span<const Series> series) {
  const auto [low, high] = pressure_range(series);
  return low <= high && high - low < deciding().pressure_still_share * (high + model::kAtmosphere_psi);
}

/// What a law that acts in all recordings starts from, whatever their order.
model::Reference reference_of_all(std::span<const Series> series) {
  model::Reference all = series.front().excitation.reference;
  for (const Series& each : series) {
    const model::Reference& one = each.excitation.reference;
    all.duration_s = std::max(all.duration_s, one.duration_s);
    all.largest_force_N = std::max(all.largest_force_N, one.largest_force_N);
    all.lowest_position_mm = std::min(all.lowest_position_mm, one.lowest_position_mm);
    all.highest_position_mm = std::max(all.highest_position_mm, one.highest_position_mm);
  }
  return all;
}

bool has_event(const ModelSpec& spec, const model::Physics& effect) {
  return std::ranges::any_of(spec.parts,
                             [&](const Part& part) { return part.physics == &effect && model::is_event(*part.law); });
}

std::size_t linear_arms(const ModelSpec& spec) {
  return static_cast<std::size_t>(std::ranges::count(spec.parts, &model::element::maxwell(), &Part::physics));
}

/// The law of the nominal model's arms under another name.
bool is_linear_arm(const model::Law& law) {
  return law.formula == model::element::maxwell().laws.front().formula;
}

/// The effect's parts that are linear arms become arms of the model.
void make_arms(ModelSpec& spec, const model::Physics& effect) {
  for (Part& part : spec.parts) {
    if (part.physics != &effect || !is_linear_arm(*part.law)) continue;
    Part arm = model::make_part(model::element::maxwell(), model::element::maxwell().laws.front());
    arm.parameters[0] = part.parameters[0];
    arm.coefficients[0] = part.coefficients[0];
    part = std::move(arm);
  }
}

ModelSpec spec_without(ModelSpec spec, const model::Physics& effect, std::optional<std::size_t> nominal_arms) {
  for (Part& part : spec.parts) {
    if (part.physics != &effect || !part.law->traits.replaces_arm) continue;
    if (nominal_arms && linear_arms(spec) >= *nominal_arms) continue;  // it stands beside them
    // The linear arm that the law had replaced.
    Part arm = model::make_part(model::element::maxwell(), model::element::maxwell().laws.front());
    arm.parameters[0] = part.parameters[0];
    arm.coefficients[0] = part.coefficients[0];
    part = std::move(arm);
  }
  std::erase_if(spec.parts, [&](const Part& part) { return part.physics == &effect; });
  return spec;
}

}  // namespace

void count_arms(Hypothesis& hypothesis) {
  if (!hypothesis.nominal_arms) return;
  const auto replaces = [](const Part& part) { return part.law->traits.replaces_arm; };
  if (std::ranges::none_of(hypothesis.fit.spec.parts, replaces)) return;
  for (const model::Physics* effect : std::vector(hypothesis.effects)) {
    const auto of_effect = [&](const Part& part) { return part.physics == effect; };
    const auto is_arm = [&](const Part& part) { return of_effect(part) && is_linear_arm(*part.law); };
    const auto arms = std::ranges::count_if(hypothesis.fit.spec.parts, is_arm);
    if (arms == 0 || arms != std::ranges::count_if(hypothesis.fit.spec.parts, of_effect)) continue;
    if (linear_arms(hypothesis.fit.spec) + static_cast<std::size_t>(arms) > *hypothesis.nominal_arms) continue;
    make_arms(hypothesis.fit.spec, *effect);
    make_arms(hypothesis.ls_spec, *effect);
    std::erase(hypothesis.effects, effect);
  }
}

bool may_be_tried(const model::Physics& effect, const Hypothesis& base, std::span<const Series> series) {
  const model::PhysicsTraits& traits = effect.traits;
  const ModelSpec& spec = base.fit.spec;
  const auto there = [&](std::string_view physics) { return spec.has(physics); };
  if (base.has(effect)) return false;
  if (spec.has(effect.name) && !traits.repeatable) return false;
  if (!traits.refines.empty() && !spec.has(traits.refines)) return false;
  if (!traits.needs_any_of.empty() && std::ranges::none_of(traits.needs_any_of, there)) return false;
  // A recording may leave its specimen's length unsaid.
  const auto says_length = [](const Series& s) { return s.excitation.reference.rest_length_mm > 0.0; };
  if (!std::ranges::all_of(series, says_length) && std::ranges::any_of(effect.laws, takes_rest_length)) return false;
  switch (traits.pressure) {
    case model::PressureNeed::kNone:
      return true;
    case model::PressureNeed::kMeasured:
      return std::ranges::any_of(series, [](const Series& s) { return !s.excitation.pressure_psi.empty(); });
    case model::PressureNeed::kStill:
      return pressure_is_still(series);
    case model::PressureNeed::kVaries:
      return pressure_varies(series);
  }
  return true;
}

/// The simplest of an effect's events stands first.
bool is_first_event(const model::Physics& effect, const model::Law& law) {
  return std::ranges::find_if(effect.laws, [](const model::Law& known) { return model::is_event(known); })->name ==
         law.name;
}

Part started_part(const model::Physics& effect, const model::Law& law, std::size_t k,
                  const model::Reference& recording) {
  Part part = model::make_part(effect, law);
  for (std::size_t i = 0; i < law.parameters.size(); ++i) {
    const auto& starts = law.parameters[i].starts;
    if (starts.empty()) continue;
    part.parameters[i] = starts[std::min(k, starts.size() - 1)];
    if (law.parameters[i].traits.starts_are_shares_of_travel)
      part.parameters[i] = recording.lowest_position_mm +
                           part.parameters[i] * (recording.highest_position_mm - recording.lowest_position_mm);
    if (law.parameters[i].traits.starts_are_shares_of_largest_force)
      part.parameters[i] =
          std::clamp(part.parameters[i] * recording.largest_force_N, law.parameters[i].lower, law.parameters[i].upper);
  }
  model::fill_from_recording(part, recording);
  return part;
}

void sort_as_in_catalogue(std::vector<const model::Physics*>& effects) {
  std::ranges::sort(effects, {}, [](const model::Physics* p) {
    return std::ranges::find(model::effects(), p) - model::effects().begin();
  });
}

bool Hypothesis::has(const model::Physics& effect) const {
  return std::ranges::find(effects, &effect) != effects.end();
}

std::string Hypothesis::key() const {
  std::string key;
  for (const auto* effect : effects) key += (key.empty() ? "" : "+") + std::string(effect->name);
  if (!empirical.empty()) key += (key.empty() ? "" : "+") + ("table of " + empirical);
  return key.empty() ? "nominal" : key;
}

Search::Search(std::span<const Series> series, const NoiseModel& instrument, unsigned threads,
               std::vector<const model::Physics*> withheld)
    : series_(series),
      instrument_problem_(series, instrument),
      coarse_(coarse(series, instrument)),
      threads_(threads),
      withheld_(std::move(withheld)) {}

std::shared_ptr<const Search::Coarse> Search::coarse(std::span<const Series> series, const NoiseModel& noise) {
  constexpr std::size_t kBins = 1500, kMostTogether = 4;
  std::size_t bins = 0;
  for (const Series& each : series) bins += each.nodes.size();
  const std::size_t together = std::min(bins / kBins, kMostTogether);
  if (together < 2) return nullptr;
  std::vector<Series> fewer = merged_bins(series, together);
  Problem problem(fewer, noise);
  return std::make_shared<const Coarse>(Coarse{std::move(fewer), std::move(problem)});
}

const Problem& Search::to_compare(const ModelSpec& base) const {
  if (coarse_ == nullptr) return instrument_problem_;
  const bool keeps = squares_of(coarse_->problem, base) <= squares_of(instrument_problem_, base);
  return keeps ? coarse_->problem : instrument_problem_;
}

bool Search::withholds(const model::Physics& effect) const {
  return std::ranges::find(withheld_, &effect) != withheld_.end();
}

Search Search::under(const NoiseModel& noise, const model::Physics& also_withheld) const {
  std::vector<const model::Physics*> withheld = withheld_;
  withheld.push_back(&also_withheld);
  return {series_, noise, threads_, std::move(withheld)};
}

Fit Search::fit_from(const ModelSpec& spec, int iterations) const {
  return instrument_problem_.fit(spec, iterations);
}

Hypothesis Search::nominal(const ModelSpec& nominal) const {
  std::vector<std::size_t> arms;
  for (std::size_t i = 0; i < nominal.parts.size(); ++i)
    if (nominal.parts[i].physics == &model::element::maxwell() && !nominal.parts[i].fixed) arms.push_back(i);
  const std::array starts{0.04, 0.4, 4.0, 40.0};
  std::vector<ModelSpec> specs{nominal};
  if (arms.size() == 1) {
    for (const double tau : starts) {
      specs.push_back(nominal);
      specs.back().parts[arms[0]].parameters[0] = tau;
    }
  } else if (arms.size() >= 2) {
    for (std::size_t i = 0; i < starts.size(); ++i) {
      for (std::size_t j = i + 1; j < starts.size(); ++j) {
        specs.push_back(nominal);
        specs.back().parts[arms[0]].parameters[0] = starts[i];
        specs.back().parts[arms[1]].parameters[0] = starts[j];
      }
    }
  }
  std::vector<Fit> fits(specs.size());
  base::parallel_for(specs.size(), threads_, [&](std::size_t i) { fits[i] = instrument_problem_.fit(specs[i], 20); });
  Hypothesis best;
  best.fit = *std::ranges::min_element(fits, {}, &Fit::chi2);
  best.nominal_arms = linear_arms(nominal);
  settle(best, false);
  return best;
}

std::vector<Search::Trial> Search::trials(const Hypothesis& base) const {
  std::vector<Trial> out;
  const ModelSpec& spec = base.ls_spec;
  const model::Reference recording = reference_of_all(series_);
  for (const model::Physics* effect : model::effects()) {
    if (!may_be_tried(*effect, base, series_) || withholds(*effect)) continue;
    for (const model::Law& known : effect->laws) {
      const model::Law& law = model::law_at(known, spec.length_scale);
      // Of several recordings each has a shape of its own, and one for all is none of them.
      if (model::describes_recording(law) && series_.size() > 1) continue;
      if (model::is_event(law)) {
        add_events(*effect, law, base, out);
        continue;
      }
      add_started(*effect, law, spec, recording, out);
    }
  }
  return out;
}

void Search::add_started(const model::Physics& effect, const model::Law& law, const ModelSpec& spec,
                         const model::Reference& recording, std::vector<Trial>& out) {
  // Every arm of the nominal model may be the one whose dashpot is not linear.
  std::vector<std::size_t> replaced{spec.parts.size()};
  if (law.traits.replaces_arm) {
    replaced.clear();
    for (std::size_t i = 0; i < spec.parts.size(); ++i)
      if (spec.parts[i].physics == &model::element::maxwell()) replaced.push_back(i);
  }
  std::size_t starts = 1;
  for (const auto& parameter : law.parameters) starts = std::max(starts, parameter.starts.size());
  for (const std::size_t arm : replaced) {
    for (std::size_t k = 0; k < starts; ++k) {
      Trial trial{&effect, &law, spec, {}};
      Part part = started_part(effect, law, k, recording);
      if (law.traits.replaces_arm) {
        part.parameters[0] = spec.parts[arm].parameters[0];
        trial.spec.parts.erase(trial.spec.parts.begin() + static_cast<std::ptrdiff_t>(arm));
      }
      trial.spec.parts.push_back(std::move(part));
      out.push_back(std::move(trial));
    }
  }
}

void Search::add_events(const model::Physics& effect, const model::Law& law, const Hypothesis& base,
                        std::vector<Trial>& out) const {
  // A gradual event moves to its time by itself; what steps is scanned for.
  constexpr std::size_t kTimes = 3;
  const std::size_t times = is_first_event(effect, law) ? kTimes : 1;
  for (const EventPlace& place : event_places(instrument_problem_, base.ls_spec, instrument_problem_.noise(),
                                              law.traits.event_force_step, times)) {
    Trial trial{&effect, &law, base.ls_spec, {}};
    trial.spec.parts.push_back(started_part(effect, law, 0, series_[place.series].excitation.reference));
    trial.spec.parts.back().parameters[model::event_parameter(law)] = place.time_s;
    out.push_back(std::move(trial));
  }
}

bool Search::explained_beside(const Trial& event, std::span<const Trial> trials, double leaves_ratio) {
  return std::ranges::any_of(trials, [&](const Trial& trial) {
    return trial.effect != event.effect && !model::describes_recording(*trial.law) &&
           explained_without(event.fit, trial.fit, leaves_ratio);
  });
}

void Search::add_further_events(std::vector<Trial>& trials, const InstrumentResolution& resolution) const {
  Trial* best = nullptr;
  // Further events follow a sudden one: a gradual one that fits best may be several sudden ones.
  for (Trial& trial : trials)
    if (model::is_event(*trial.law) && is_first_event(*trial.effect, *trial.law) &&
        (best == nullptr || trial.fit.chi2 < best->fit.chi2))
      best = &trial;
  if (best == nullptr || below_resolution(best->fit.spec, resolution)) return;
  if (explained_beside(*best, trials, deciding().law_leaves_ratio)) return;
  const auto may_stay = [&](const ModelSpec& spec) {
    return !below_resolution(spec, resolution) && !at_wrong_bound(spec.parts.back());
  };
  best->fit = with_further_events(instrument_problem_, best->fit, may_stay);
}

/// Of each effect, by what its trials leave so far.
void Search::keep_better_half(std::vector<Trial>& trials) {
  std::ranges::stable_sort(trials, {}, [](const Trial& t) { return t.fit.chi2; });
  std::map<const model::Physics*, std::size_t> count, seen;
  for (const Trial& trial : trials) ++count[trial.effect];
  std::erase_if(trials, [&](const Trial& t) { return 2 * seen[t.effect]++ >= count[t.effect] + 1; });
}

/// Of one effect, laws that arrived at the same optimum from another start, and laws that leave far more than another.
void Search::drop_repeated(std::vector<Trial>& fitted) {
  constexpr double kSame = 1e-5;
  std::vector<Trial> kept;
  for (Trial& trial : fitted) {
    const bool needed = std::ranges::none_of(fitted, [&](const Trial& other) {
      return other.effect == trial.effect && trial.fit.chi2 > deciding().law_leaves_ratio * other.fit.chi2;
    });
    const bool known = std::ranges::any_of(kept, [&](const Trial& other) {
      return other.law == trial.law && std::fabs(other.fit.chi2 - trial.fit.chi2) < kSame * other.fit.chi2;
    });
    if (needed && !known) kept.push_back(std::move(trial));
  }
  fitted = std::move(kept);
}

void Search::screen(std::vector<Trial>& trials, const ModelSpec& base) const {
  const Problem& problem = to_compare(base);
  base::parallel_for(trials.size(), threads_,
                     [&](std::size_t i) { trials[i].fit = problem.fit(trials[i].spec, kScreenSteps); });
  keep_better_half(trials);
  base::parallel_for(trials.size(), threads_,
                     [&](std::size_t i) { trials[i].fit = problem.fit(trials[i].fit.spec, kScreenSteps); });
  std::ranges::stable_sort(trials, {}, [](const Trial& t) { return t.fit.chi2; });
}

std::vector<Hypothesis> Search::extend(const Hypothesis& base, std::size_t keep, bool thorough) const {
  std::vector<Trial> all = trials(base);
  screen(all, base.ls_spec);
  std::vector<Trial> chosen;
  std::map<const model::Physics*, int> per_effect;
  std::size_t places = 0;
  for (Trial& trial : all) {
    const auto [taken, first] = per_effect.try_emplace(trial.effect, 0);
    // An effect that contains another fits wherever that one does: it takes no place from the others.
    if (first && trial.effect->traits.contains.empty()) ++places;
    // Three trials (a law from one of its starts) of each of the most promising effects, a single trial of the others.
    trial.promising = places <= keep;
    const int most = trial.promising ? 3 : thorough ? 1 : 0;
    if (taken->second >= most) continue;
    ++taken->second;
    chosen.push_back(std::move(trial));
  }
  base::parallel_for(chosen.size(), threads_, [&](std::size_t i) {
    Trial& trial = chosen[i];
    trial.fit = instrument_problem_.fit(trial.fit.spec, 30);
    if (!model::is_event(*trial.law)) trial.fit = without_idle_events(instrument_problem_, trial.fit);
  });
  // It stands at the best of all bins already (event_places); moving it does not make up for ten times the squares.
  constexpr double kHopeless = 10.0;
  std::vector<Trial*> events;
  for (Trial& trial : chosen)
    if (model::is_event(*trial.law) && !explained_beside(trial, chosen, kHopeless)) events.push_back(&trial);
  base::parallel_for(events.size(), threads_,
                     [&](std::size_t i) { events[i]->fit = refine_event(instrument_problem_, events[i]->fit); });
  const InstrumentResolution resolution = resolution_of(series_);
  add_further_events(chosen, resolution);
  const auto no_law = [&](const ModelSpec& fitted, std::span<const model::Physics* const> effects) {
    return below_resolution(fitted, resolution) || beyond_physical_size(fitted, effects, series_);
  };
  std::erase_if(chosen, [&](const Trial& trial) {
    std::vector<const model::Physics*> effects = base.effects;
    effects.push_back(trial.effect);
    return no_law(trial.fit.spec, effects);
  });
  drop_repeated(chosen);
  std::vector<Hypothesis> out(chosen.size());
  base::parallel_for(chosen.size(), threads_, [&](std::size_t i) {
    Hypothesis& hypothesis = out[i];
    hypothesis.effects = base.effects;
    hypothesis.effects.push_back(chosen[i].effect);
    hypothesis.nominal_arms = base.nominal_arms;
    sort_as_in_catalogue(hypothesis.effects);
    hypothesis.fit = std::move(chosen[i].fit);
    settle(hypothesis, chosen[i].promising);
  });
  // Of each effect the law with the best evidence.
  std::ranges::stable_sort(out, std::greater<>(), &Hypothesis::evidence);
  std::vector<Hypothesis> best;
  for (Hypothesis& hypothesis : out) {
    if (no_law(hypothesis.fit.spec, hypothesis.effects)) continue;
    if (std::ranges::none_of(best, [&](const Hypothesis& other) { return other.effects == hypothesis.effects; }))
      best.push_back(std::move(hypothesis));
  }
  return best;
}

std::vector<Hypothesis> Search::other_laws(const Hypothesis& chosen, const model::Physics& effect,
                                           std::size_t tried) const {
  const InstrumentResolution resolution = resolution_of(series_);
  const ModelSpec rest = spec_without(chosen.ls_spec, effect, chosen.nominal_arms);
  std::vector<Trial> other;
  for (const model::Law& known : effect.laws) {
    const model::Law& law = model::law_at(known, rest.length_scale);
    const bool is_had = std::ranges::any_of(chosen.ls_spec.parts, [&](const Part& part) { return part.law == &law; });
    if (is_had || model::is_event(law) || (model::describes_recording(law) && series_.size() > 1)) continue;
    add_started(effect, law, rest, reference_of_all(series_), other);
  }
  screen(other, rest);
  other.resize(std::min(other.size(), tried));
  std::vector<Hypothesis> settled(other.size());
  base::parallel_for(other.size(), threads_, [&](std::size_t i) {
    settled[i] = chosen;
    settled[i].fit = instrument_problem_.fit(other[i].fit.spec, 30);
    settle(settled[i], false);
  });
  std::erase_if(settled, [&](const Hypothesis& hypothesis) {
    return below_resolution(hypothesis.fit.spec, resolution) ||
           beyond_physical_size(hypothesis.fit.spec, hypothesis.effects, series_);
  });
  return settled;
}

Hypothesis Search::with_other_laws(const Hypothesis& chosen) const {
  constexpr std::size_t kTried = 2;
  Hypothesis best = chosen;
  for (const model::Physics* effect : chosen.effects) {
    if (effect->laws.size() < 2 || has_event(best.ls_spec, *effect)) continue;
    for (Hypothesis& hypothesis : other_laws(best, *effect, kTried))
      if (hypothesis.evidence > best.evidence) best = std::move(hypothesis);
  }
  return best;
}

std::optional<Hypothesis> Search::inside_ranges(const Hypothesis& chosen) const {
  constexpr std::size_t kTried = 6;
  std::optional<Hypothesis> out;
  for (const model::Physics* effect : chosen.effects) {
    const Hypothesis& now = out ? *out : chosen;
    const auto at_end = [&](const Part& part) { return part.physics == effect && at_wrong_bound(part); };
    const auto has_at_end = [&](const ModelSpec& spec) { return std::ranges::any_of(spec.parts, at_end); };
    if (!has_at_end(now.fit.spec)) continue;
    std::vector<Hypothesis> others;
    if (has_event(now.fit.spec, *effect)) {
      ModelSpec fewer = now.fit.spec;
      std::erase_if(fewer.parts, at_end);
      if (!fewer.has(effect->name)) continue;
      others.push_back(now);
      others.back().fit = instrument_problem_.fit(fewer, 30);
      settle(others.back(), false);
    } else {
      others = other_laws(now, *effect, kTried);
    }
    const Hypothesis* best = nullptr;
    for (const Hypothesis& other : others) {
      if (has_at_end(other.fit.spec) || has_at_end(other.ls_spec)) continue;
      if (other.ls_chi2 > deciding().law_leaves_ratio * chosen.ls_chi2) continue;
      if (best == nullptr || other.evidence > best->evidence) best = &other;
    }
    if (best != nullptr) out = *best;
  }
  return out;
}

Hypothesis Search::without(const Hypothesis& whole, const model::Physics& effect) const {
  Hypothesis out;
  out.effects = whole.effects;
  std::erase(out.effects, &effect);
  out.empirical = whole.empirical;
  out.nominal_arms = whole.nominal_arms;
  out.fit.spec = spec_without(whole.fit.spec, effect, whole.nominal_arms);
  out.fit = instrument_problem_.fit(out.fit.spec, 25);
  settle(out, true);
  count_arms(out);
  return out;
}

void Search::settle(Hypothesis& hypothesis, bool restart_arms) const {
  if (restart_arms) {
    std::vector<std::size_t> arms;
    for (std::size_t i = 0; i < hypothesis.fit.spec.parts.size(); ++i)
      if (hypothesis.fit.spec.parts[i].physics == &model::element::maxwell()) arms.push_back(i);
    Fit best = hypothesis.fit;
    if (best.chi2 <= 0.0 && best.rows == 0) best = instrument_problem_.fit(hypothesis.fit.spec, 10);
    const std::array pairs{std::array{0.08, 0.8}, std::array{0.5, 5.0}, std::array{0.15, 15.0}};
    if (arms.size() >= 2) {
      // A few steps tell which start is the best; the rest of the steps are its own.
      constexpr int kToCompare = 4, kToTheEnd = 16;
      const Problem& compared = to_compare(best.spec);
      std::optional<Fit> started;
      for (const auto& start : pairs) {
        ModelSpec spec = hypothesis.fit.spec;
        spec.parts[arms[0]].parameters[0] = start[0];
        spec.parts[arms[1]].parameters[0] = start[1];
        Fit fit = compared.fit(spec, kToCompare);
        if (!started || fit.chi2 < started->chi2) started = std::move(fit);
      }
      Fit fit = instrument_problem_.fit(started->spec, kToTheEnd);
      if (fit.chi2 < best.chi2) best = std::move(fit);
    }
    hypothesis.fit = std::move(best);
  }
  hypothesis.ls_chi2 = hypothesis.fit.chi2;
  hypothesis.ls_spec = hypothesis.fit.spec;
  NoiseModel noise = instrument_problem_.estimate_noise(hypothesis.fit.spec);
  for (int round = 0; round < 2; ++round) {
    if (noise.coloured_N == 0.0 && round > 0) break;
    const Problem problem(series_, noise);
    Fit fit = problem.fit(hypothesis.fit.spec, 8);
    noise = problem.estimate_noise(fit.spec);
    hypothesis.fit = std::move(fit);
  }
  // Under the noise of its own residual a fit may leave a poor optimum, where the first one stayed.
  constexpr double kBetter = 0.9;
  constexpr int kSteps = 20;
  if (squares_of(instrument_problem_, hypothesis.fit.spec) < kBetter * hypothesis.ls_chi2) {
    Fit better = instrument_problem_.fit(hypothesis.fit.spec, kSteps);
    hypothesis.ls_chi2 = better.chi2;
    hypothesis.ls_spec = std::move(better.spec);
  }
  const Problem problem(series_, noise);
  hypothesis.fit.noise = noise;
  hypothesis.fit.log_likelihood = problem.log_likelihood(hypothesis.fit.spec, noise);
  const double numbers = static_cast<double>(counted_numbers(hypothesis.fit.spec));
  hypothesis.evidence = hypothesis.fit.log_likelihood -
                        deciding().numbers_cost_log_rows * numbers * std::log(static_cast<double>(hypothesis.fit.rows));
}

}  // namespace isorig::identify
