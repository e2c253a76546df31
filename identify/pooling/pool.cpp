#include "identify/pooling/pool.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "base/formatted.hpp"
#include "base/parallel.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/search/repeated_evidence.hpp"
#include "identify/pooling/campaign_grid.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::identify::pooling {
namespace {

constexpr double kReadShare = 0.5;  // of the time that a pool takes; the rest is its quantities

/// Numbers of two models share names and no meaning: the stiffness of a spring beside one arm is not that beside two.
void check_same_model(const std::vector<ReadDiagnosis>& recordings) {
  const auto names = [](const ReadDiagnosis& of) {
    std::string out;
    for (const std::string& name : of.asked) out += (out.empty() ? "" : ", ") + name;
    return out;
  };
  const std::string first = names(recordings.front());
  for (const ReadDiagnosis& one : recordings)
    if (names(one) != first)
      throw PoolError((one.folder / "diagnosis.json").string(), "its nominal model has the numbers " + names(one) +
                                                                    ", that of " + recordings.front().folder.string() +
                                                                    " has " + first +
                                                                    "; pool diagnoses of one nominal model (--model)");
}

EffectEvidence evidence_in(const ReadDiagnosis& of, std::size_t actuator, const std::string& effect,
                           double prior_probability) {
  EffectEvidence out{actuator, Says::kNothing, std::numeric_limits<double>::quiet_NaN()};
  if (of.verdict == "cannot_judge") return out;
  if (const auto named = std::ranges::find(of.missing, effect, &ReadEffect::name); named != of.missing.end()) {
    out.probability = named->probability;
    out.says = named->refused ? Says::kRefused : Says::kProbable;
    return out;
  }
  bool tried = false;
  double weight = 0.0;
  for (const auto& set : of.tried)
    if (std::ranges::find(set.effects, effect) != set.effects.end()) {
      tried = true;
      weight += set.weight;
    }
  // What is unknown may be this effect in another form.
  if (!tried || of.verdict == "unknown_physics" || std::ranges::find(of.invisible, effect) != of.invisible.end())
    return out;
  out.probability = kSurest * std::min(weight, 1.0);
  out.says = out.probability > prior_probability ? Says::kProbable : Says::kNotNamed;
  return out;
}

EffectPool pool_effect(const PooledCampaign& campaign, const model::Physics& physics) {
  EffectPool out{std::string(physics.name), model::effect_words(physics.name), false, {}, {}};
  for (const model::Law& law : physics.laws) out.event = out.event || model::is_event(law);
  const double cost = prior_cost(physics, SelectionOptions{});
  // Two names of one weight are tied by rounding alone: a tenth above the prior is the least that counts as a gain.
  const double prior = 1.1 / (1.0 + std::exp(cost));
  std::vector<EffectEvidence> evidence;
  for (std::size_t r = 0; r < campaign.recordings.size(); ++r) {
    evidence.push_back(evidence_in(campaign.recordings[r], campaign.actuator_of[r], out.name, prior));
    out.probability.push_back(evidence.back().probability);
  }
  out.presence = pool_presence(evidence, campaign.actuators.size(), {-cost, out.event});
  return out;
}

void place_all(PooledCampaign& out) {
  std::set<std::string> specimens;
  std::set<double> pressures;
  for (const ReadDiagnosis& one : out.recordings) {
    specimens.insert(one.place.specimen);
    pressures.insert(one.place.pressure_psi);
  }
  out.actuators.assign(specimens.begin(), specimens.end());
  std::ranges::stable_sort(out.actuators, counts_before);
  out.pressures_psi.assign(pressures.begin(), pressures.end());
  std::map<std::string, std::size_t> number;
  for (std::size_t i = 0; i < out.actuators.size(); ++i) number[out.actuators[i]] = i;
  std::ranges::stable_sort(out.recordings, [&](const ReadDiagnosis& a, const ReadDiagnosis& b) {
    return std::tuple(number[a.place.specimen], a.place.pressure_psi, a.place.repetition) <
           std::tuple(number[b.place.specimen], b.place.pressure_psi, b.place.repetition);
  });
  for (const ReadDiagnosis& one : out.recordings) out.actuator_of.push_back(number[one.place.specimen]);
}

/// The diagnoses that are read, and those that cannot be pooled.
struct Taken {
  std::vector<ReadDiagnosis> diagnoses;
  std::vector<std::string> names;  ///< of each, for people
  std::vector<LeftOut> left_out;
};

std::string shown_name(const Source& source) {
  return source.name.empty() ? source.diagnosis.string() : source.name;
}

/// Diagnoses of one recording, in several folders: of a copy of it, or by a link. For each but the first why its
/// numbers do not count; where the copies name different places, for all of them.
std::map<std::size_t, std::string> repeated_in(const Taken& taken) {
  std::map<double, std::vector<std::size_t>> of_recording;
  for (std::size_t i = 0; i < taken.diagnoses.size(); ++i)
    for (const double id : taken.diagnoses[i].recording_ids)
      if (auto& with = of_recording[id]; with.empty() || with.back() != i) with.push_back(i);
  std::map<std::size_t, std::string> out;
  for (const auto& [id, alike] : of_recording) {
    if (alike.size() < 2) continue;
    const auto place = [&](std::size_t i) {
      return std::pair(taken.diagnoses[i].place.specimen, taken.diagnoses[i].place.pressure_psi);
    };
    const bool same_place = std::ranges::all_of(alike, [&](std::size_t i) { return place(i) == place(alike.front()); });
    for (const std::size_t i : alike) {
      const std::string& other = taken.names[i == alike.front() ? alike[1] : alike.front()];
      if (!same_place)
        out.try_emplace(i,
                        "is of the same recording as " + other +
                            ", and they name different specimens or pressures: which of them is right it does not say");
      else if (i != alike.front())
        out.try_emplace(i, "is of the same recording as " + other + "; its numbers would count twice");
    }
  }
  return out;
}

/// Reads all; of those that cannot be pooled it says why, or throws.
Taken take(const std::vector<Source>& sources, const PoolOptions& options) {
  std::vector<ReadDiagnosis> read(sources.size());
  std::vector<std::string> why(sources.size());
  const bool leave_out = options.unpoolable == Unpoolable::kLeaveOut;
  std::atomic<std::size_t> done{0};
  base::parallel_for(sources.size(), options.threads, [&](std::size_t i) {
    if (options.on_progress)
      options.on_progress(kReadShare * static_cast<double>(done++) / static_cast<double>(sources.size()));
    try {
      read[i] = read_diagnosis(sources[i]);
    } catch (const PoolError& e) {
      if (!leave_out) throw;
      why[i] = e.why();
    }
  });
  Taken out;
  const auto leave = [&](const Source& source, const std::string& reason, std::optional<Place> place) {
    out.left_out.push_back({source.diagnosis, shown_name(source), page_in(source.diagnosis), reason, std::move(place)});
  };
  std::vector<const Source*> of;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    if (why[i].empty()) {
      out.diagnoses.push_back(std::move(read[i]));
      out.names.push_back(leave_out ? shown_name(sources[i]) : sources[i].diagnosis.string());
      of.push_back(&sources[i]);
    } else {
      leave(sources[i], why[i], {});
    }
  }
  const std::map<std::size_t, std::string> repeated = repeated_in(out);
  if (repeated.empty()) return out;
  if (!leave_out) {
    const auto& [i, reason] = *repeated.rbegin();
    throw PoolError((out.diagnoses[i].folder / "diagnosis.json").string(), reason);
  }
  std::vector<ReadDiagnosis> kept;
  for (std::size_t i = 0; i < out.diagnoses.size(); ++i) {
    if (const auto found = repeated.find(i); found != repeated.end())
      leave(*of[i], found->second, out.diagnoses[i].place);
    else
      kept.push_back(std::move(out.diagnoses[i]));
  }
  out.diagnoses = std::move(kept);
  return out;
}

PoolError too_few(const Taken& taken, std::size_t all) {
  constexpr std::size_t kNamed = 3;
  std::string which;
  for (std::size_t i = 0; i < std::min(kNamed, taken.left_out.size()); ++i)
    which += (i == 0 ? "" : "; ") + taken.left_out[i].name + " " + taken.left_out[i].why;
  return PoolError(base::formatted("of %zu diagnoses %zu can be pooled, and a pool needs two. Left out: ", all,
                                   taken.diagnoses.size()) +
                   which + (taken.left_out.size() > kNamed ? "; ..." : ""));
}

void check_twice(const std::vector<Source>& sources) {
  std::set<std::filesystem::path> seen;
  for (const Source& source : sources) {
    std::error_code error;
    auto whole = std::filesystem::weakly_canonical(source.diagnosis, error);
    if (error) whole = std::filesystem::absolute(source.diagnosis).lexically_normal();
    if (!seen.insert(whole.has_filename() ? whole : whole.parent_path()).second)
      throw PoolError(source.diagnosis.string(), "is given twice; its numbers would count twice");
  }
}

}  // namespace

PooledCampaign pool(const std::vector<Source>& sources, const PoolOptions& options) {
  if (std::error_code error; sources.size() == 1 && !std::filesystem::exists(sources.front().diagnosis, error))
    throw PoolError(sources.front().diagnosis.string(), "is not there; name the folders of a whole campaign");
  if (sources.size() < 2) throw PoolError("one diagnosis is nothing to pool; name the folders of a whole campaign");
  check_twice(sources);
  PooledCampaign out;
  Taken taken = take(sources, options);
  if (taken.diagnoses.size() < 2) throw too_few(taken, sources.size());
  out.recordings = std::move(taken.diagnoses);
  out.left_out = std::move(taken.left_out);
  check_same_model(out.recordings);
  place_all(out);

  for (const model::Physics* physics : model::effects()) {
    EffectPool effect = pool_effect(out, *physics);
    if (effect.presence.judged() > 0) out.effects.push_back(std::move(effect));
  }
  std::ranges::stable_sort(out.effects, [](const EffectPool& a, const EffectPool& b) {
    return std::pair(a.presence.present(), a.presence.anywhere) > std::pair(b.presence.present(), b.presence.anywhere);
  });

  out.quantities = choose_quantities(out, out.not_compared);
  std::size_t actuator_looks = 0, recording_looks = 0;
  for (const Quantity& one : out.quantities) {
    actuator_looks += out.actuators.size();
    recording_looks += one.measurements.size();
  }
  std::atomic<std::size_t> pooled{0};
  base::parallel_for(out.quantities.size(), options.threads, [&](std::size_t i) {
    constexpr double kThreeToOne = 1.0986;
    if (options.on_progress)
      options.on_progress(kReadShare + (1.0 - kReadShare) * static_cast<double>(pooled++) /
                                           static_cast<double>(out.quantities.size()));
    Quantity& one = out.quantities[i];
    one.pooled = pool_quantity(one.measurements, out.actuators.size());
    widen_by_law_error(one);
    one.outliers = find_outliers(one.measurements, one.pooled, {actuator_looks, recording_looks});
    one.grows = one.pooled.slope && one.pooled.slope->low95 * one.pooled.slope->high95 > 0.0 &&
                *one.pooled.log_evidence_of_slope > kThreeToOne;
  });
  out.findings = findings_of(out);
  return out;
}

void widen_by_law_error(Quantity& quantity) {
  // Six of seven lie within 1.465 standard deviations: 1.96 / 1.465 = 1.338, and 1.338^2 - 1 = 0.89^2.
  constexpr double kShare = 0.89;
  std::map<double, std::vector<double>> errors;
  std::vector<double> all;
  for (const Measurement& m : quantity.measurements) {
    errors[m.pressure_psi].push_back(m.standard_error);
    all.push_back(m.standard_error);
  }
  const auto widen = [](Estimate& estimate, double sd) {
    estimate.standard_error = std::hypot(estimate.standard_error, sd);
    estimate.low95 = estimate.value - std::hypot(estimate.value - estimate.low95, kZ95 * sd);
    estimate.high95 = estimate.value + std::hypot(estimate.high95 - estimate.value, kZ95 * sd);
  };
  // What all recordings share is in every actuator's number as it is in the mean: however well its own recordings
  // agree, they agree on a value that is off by that.
  const double shared = kShare * base::median(all);
  widen(quantity.pooled.level, shared);
  for (Pooled::Actuator& one : quantity.pooled.actuators) {
    widen(one.level, shared);
    one.unpooled_error = std::hypot(one.unpooled_error, shared);
  }
  if (!quantity.pooled.slope) return;
  double mean = 0.0, squares = 0.0, variance = 0.0;
  for (const auto& [pressure, of] : errors) mean += pressure / static_cast<double>(errors.size());
  for (const auto& [pressure, of] : errors) {
    const double away = pressure - mean;
    squares += away * away;
    variance += std::pow(away * kShare * base::median(of), 2);
  }
  const double shared_per_psi = std::sqrt(variance) / squares;
  widen(*quantity.pooled.slope, shared_per_psi);
  for (Pooled::Actuator& one : quantity.pooled.actuators)
    if (one.slope) widen(*one.slope, shared_per_psi);
}

std::string relative_to(const std::filesystem::path& folder, const std::filesystem::path& path) {
  std::error_code error;
  return std::filesystem::absolute(path, error)
      .lexically_normal()
      .lexically_relative(std::filesystem::absolute(folder, error).lexically_normal())
      .generic_string();
}

std::string name_of(const ReadDiagnosis& recording) {
  const Place& at = recording.place;
  return at.specimen + base::formatted(", %g psi", at.pressure_psi) +
         (at.repetition > 0 ? ", repetition " + std::to_string(at.repetition) : std::string());
}

std::string plus_minus(double value, double half_width) {
  if (!(half_width > 0.0) || !std::isfinite(half_width)) return base::formatted("%.3g", value);
  // One digit of the half width, two where the first is a one.
  const double tens = std::floor(std::log10(half_width));
  const int decimals = std::max(0, static_cast<int>(-tens) + (half_width / std::pow(10.0, tens) < 1.95 ? 1 : 0));
  return base::formatted("%.*f ± %.*f", decimals, value, decimals, half_width);
}

}  // namespace isorig::identify::pooling
