#include "identify/diagnose/diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "identify/diagnose/explain/locate.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/diagnose/guard/start_up_cut.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "identify/diagnose/search/hysteresis.hpp"
#include "identify/diagnose/search/parsimony.hpp"
#include "identify/diagnose/signal/noise_level.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

/// rms of measured minus simulated force over all usable rows.
double rmse(const model::ModelSpec& spec, std::span<const Series> series, std::span<const std::vector<bool>> usable) {
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < series.size(); ++i) {
    const Series& each = series[i];
    model::RunningModel running(spec, each.excitation.reference);
    running.reset(each.excitation.instants.front());
    for (std::size_t k = 0; k < each.excitation.instants.size(); ++k) {
      const double e = each.recording.frame.force_N[k] - running.step(each.excitation.instants[k]);
      if (!usable[i].empty() && !usable[i][k]) continue;
      squares += e * e;
      ++count;
    }
  }
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0.0;
}

/// The time of a slip to the row: bins only say between which of them it was.
void place_slips(model::ModelSpec& spec, std::span<const Series> series, std::span<const std::vector<bool>> usable) {
  for (auto& part : spec.parts) {
    if (part.physics->name != "grip_slip") continue;
    const Series& first = series[0];
    double before = first.nodes.front().t_s, after = first.nodes.back().t_s;
    for (const auto& node : first.nodes) {
      if (node.t_s < part.parameters[0])
        before = node.t_s;
      else {
        after = node.t_s;
        break;
      }
    }
    double best_s = part.parameters[0], best = rmse(spec, series.first(1), usable);
    for (const auto& row : first.excitation.instants) {
      if (row.t_s < before - 1.0 || row.t_s > after + 1.0) continue;
      part.parameters[0] = row.t_s - 0.5 * row.dt_s;
      if (const double value = rmse(spec, series.first(1), usable); value < best) {
        best = value;
        best_s = part.parameters[0];
      }
    }
    part.parameters[0] = best_s;
  }
}

bool moves(const messages::Recording& recording) {
  const auto& frame = recording.frame;
  if (frame.size() < 2) return false;
  const auto [low, high] = std::ranges::minmax_element(frame.position_mm);
  return *high - *low > 20.0 * white_noise(frame.t_s, frame.position_mm);
}

bool pressure_moves(const messages::Recording& recording) {
  if (!recording.pressure || recording.pressure->size() < 20) return false;
  const auto& gauge = *recording.pressure;
  const auto [low, high] = std::ranges::minmax_element(gauge.pressure_psi);
  return *high - *low > 20.0 * white_noise(gauge.t_s, gauge.pressure_psi);
}

void note_equivalences(const model::ModelSpec& spec, Diagnosis& diagnosis) {
  const bool solid = spec.has("spring") && spec.has("maxwell");
  if (solid)
    diagnosis.notes.emplace_back(
        "A spring in series with the specimen (grips, load cell, frame) turns this model into another of the "
        "same "
        "form: no force and crosshead reading can tell its stiffness. It is not looked for, and the "
        "stiffnesses "
        "here are those of specimen and load train together.");
}

void warn_of_pressures(std::span<const Series> series, Diagnosis& diagnosis) {
  std::vector<double> nominal_psi;
  for (const Series& each : series) nominal_psi.push_back(each.recording.metadata.nominal_pressure_psi.value_or(0.0));
  if (auto text = mixed_pressures(nominal_psi); !text.empty()) diagnosis.warnings.push_back(std::move(text));
}

/// A verdict on numbers that are none is no verdict.
void refuse_unless_finite(const Diagnosis& d) {
  bool finite = true;
  for (const double value :
       {d.noise_N, d.noise_scale, d.unexplained, d.nominal_errors.train_rmse_N, d.nominal_errors.heldout_rmse_N,
        d.model_errors.train_rmse_N, d.model_errors.heldout_rmse_N}) {
    finite = finite && std::isfinite(value);
  }
  for (const MissingEffect& missing : d.missing) {
    finite = finite && std::isfinite(missing.probability);
    for (const NamedValue& value : missing.parameters) finite = finite && std::isfinite(value.value);
  }
  if (!finite) {
    throw std::domain_error(
        "the diagnosis did not come out in finite numbers, so there is no verdict; look at the recordings' forces and "
        "positions for values that cannot be meant");
  }
}

/// Filling stretches the specimen, and its arms keep some of that force when the rows of the filling are
/// gone: no physics that the nominal model lacks, but a state that is not known.
void add_what_filling_left(model::ModelSpec& spec, double duration_s, double start_s) {
  const model::Physics& physics = model::element::arm_start();
  const auto arms = std::ranges::count(spec.parts, &model::element::maxwell(), &model::Part::physics);
  for (std::ptrdiff_t arm = 1; arm <= arms; ++arm) {
    model::Part part = model::make_part(physics, physics.laws[0]);
    part.parameters[1] = static_cast<double>(arm);
    part.parameters[2] = duration_s;
    part.parameters[3] = start_s;
    spec.parts.push_back(std::move(part));
  }
}

}  // namespace

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kConsistent:
      return "consistent";
    case Verdict::kMissingPhysics:
      return "missing_physics";
    case Verdict::kUnknownPhysics:
      return "unknown_physics";
  }
  return "";
}

std::string mixed_pressures(std::span<const double> nominal_psi) {
  if (nominal_psi.empty()) return {};
  const auto [low, high] = std::ranges::minmax(nominal_psi);
  if (high - low <= 0.05 * high) return {};
  char text[240];
  std::snprintf(text, sizeof text,
                "The recordings were made at nominal pressures from %.3g to %.3g psi and are fitted with one "
                "material. An actuator's stiffness follows its pressure: diagnose each pressure by itself, unless "
                "that is what is to be shown.",
                low, high);
  return text;
}

Study diagnose(std::vector<messages::Recording> recordings, std::vector<std::string> names,
               const model::ModelSpec& given, const DiagnosisOptions& options) {
  Study study;
  model::ModelSpec nominal = given;
  std::vector<double> duration_s;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    const auto& t_s = recordings[i].frame.t_s;
    duration_s.push_back(t_s.empty() ? 0.0 : t_s.back() - t_s.front());
    // An isometric recording is driven by its pressure alone: its filling is the experiment.
    if (moves(recordings[i]) || !nominal.has("pressure_coupling")) {
      const double start_s = t_s.empty() ? 0.0 : t_s.front();
      if (auto cut = cut_start_up(recordings[i])) study.faults.push_back(std::move(*cut));
      if (!t_s.empty() && t_s.front() > start_s) add_what_filling_left(nominal, duration_s[i], t_s.front());
    }
    const auto& frame = recordings[i].frame;
    constexpr std::size_t kFewest = 100;
    if (frame.size() < kFewest)
      throw std::invalid_argument(names[i] + ": " + std::to_string(frame.size()) +
                                  " rows are too few to judge a model by (at least " + std::to_string(kFewest) + ")");
    if (!moves(recordings[i]) && !(nominal.has("pressure_coupling") && pressure_moves(recordings[i])))
      throw std::invalid_argument(
          names[i] + ": nothing moves in this recording, or its samples are too far apart to follow the motion");
    refuse_implausible(recordings[i], names[i], nominal);
    if (auto odd = odd_pressure(recordings[i])) study.faults.push_back(std::move(*odd));
  }
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Guarded guarded = guard_recording(recordings[i]);
    study.faults.insert(study.faults.end(), guarded.faults.begin(), guarded.faults.end());
    study.series.push_back(prepare_series(names[i], std::move(recordings[i]), guarded.usable));
    // A slip knows its recording by its duration, and `predict` sees the whole of it.
    study.series.back().excitation.reference.duration_s = duration_s[i];
    study.usable.push_back(std::move(guarded.usable));
    const Excitation& excitation = study.series.back().excitation;
    if (excitation.pressure_clock_s != 0.0) {
      char text[160];
      std::snprintf(text, sizeof text,
                    "the pressure's time stamps are %.3f s (+- %.3f s) %s against the frame's, by its response to "
                    "the motion; corrected",
                    std::fabs(excitation.pressure_clock_s), excitation.pressure_clock_error_s,
                    excitation.pressure_clock_s > 0.0 ? "late" : "early");
      study.faults.push_back({"clock", excitation.instants.front().t_s, excitation.instants.back().t_s, 0, text});
    }
  }
  share_noise(study.series);
  study.noise = instrument_noise(study.series, study.usable);
  const Search search(study.series, study.noise.weighing, options.threads);
  SelectionOptions selecting = options.selection;
  if (study.noise.measured()) selecting.most_noise_scale = 2.0;
  // A level from the motion itself is a mean over fast and slow; the quiet half is not all of it.
  if (study.noise.measured() && study.noise.source != NoiseSource::kRests) selecting.least_noise_scale = 1.0;
  selecting.count_looks = study.noise.source != NoiseSource::kRests;
  study.selection = select_effects(search, nominal, selecting);
  prefer_simpler_laws(study.selection, search);
  const Selection& selection = study.selection;
  const Hypothesis& chosen = selection.chosen();

  Diagnosis& out = study.diagnosis;
  out.faults = study.faults;
  out.instrument = study.noise.noise;
  out.noise_source = study.noise.source;
  out.noise_N = std::hypot(study.noise.noise.white_N, study.noise.noise.coloured_N);
  out.nominal = selection.nominal().fit.spec;
  out.model = chosen.fit.spec;
  place_slips(out.model, study.series, study.usable);
  out.nominal.name = nominal.name;
  out.model.name = nominal.name;
  const Problem problem(study.series, chosen.fit.noise);
  // Bins average coloured noise and the noise left in them is less than the readings'; the rests know better.
  NoiseModel stated = chosen.fit.noise;
  if (study.noise.noise.coloured_N > stated.coloured_N) {
    stated.coloured_N = study.noise.noise.coloured_N;
    stated.correlation_s = study.noise.noise.correlation_s;
  }
  const auto values = intervals(Problem(study.series, stated), out.model, Spread::kMoves);
  for (const auto* effect : chosen.effects) {
    MissingEffect missing;
    missing.effect = effect;
    missing.probability = selection.probability.at(effect);
    missing.size_N = selection.size_N.at(effect);
    for (std::size_t p = 0; p < chosen.fit.spec.parts.size(); ++p) {
      if (chosen.fit.spec.parts[p].physics != effect) continue;
      missing.law = chosen.fit.spec.parts[p].law->name;
      missing.parameters = values[p];
    }
    out.missing.push_back(std::move(missing));
  }
  std::ranges::stable_sort(out.missing, std::greater<>(), &MissingEffect::size_N);
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    if (i == selection.best || selection.weight[i] < 0.005) continue;
    Alternative alternative;
    for (const auto* effect : selection.pool[i].effects) alternative.effects.emplace_back(effect->name);
    alternative.probability = selection.weight[i];
    out.alternatives.push_back(std::move(alternative));
  }
  std::ranges::stable_sort(out.alternatives, std::greater<>(), &Alternative::probability);
  if (out.alternatives.size() > 8) out.alternatives.resize(8);

  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& h = selection.pool[i];
    out.tried.push_back(
        {h.key(), selection.weight[i], h.evidence, selection.excess[i], std::ranges::count(h.fit.at_bound, true) > 0});
  }
  std::ranges::stable_sort(out.tried, std::greater<>(), &Explanation::weight);
  out.rows = chosen.fit.rows;
  out.noise_scale = selection.noise_scale;
  const double rows = static_cast<double>(chosen.fit.rows);
  const double left = selection.excess[selection.best], before = selection.excess[0];
  // Two standard deviations of what noise alone leaves, where its level is not from rests.
  const double chance = selecting.count_looks ? 2.0 * std::sqrt(2.0 * rows) : 0.0;
  out.unexplained = before > 0.0 ? std::max(left - chance, 0.0) / before : 0.0;
  out.described_by = chosen.empirical;
  constexpr double kMuch = 0.12;
  const bool structure_left = left > 0.2 * rows && left > 400.0;
  // Physics that has no name in the catalogue, or too much left for the names found to be the story.
  if (!chosen.empirical.empty() || (structure_left && (out.missing.empty() || out.unexplained > kMuch)))
    out.verdict = Verdict::kUnknownPhysics;
  else if (!out.missing.empty())
    out.verdict = Verdict::kMissingPhysics;
  // A table that leaves little stands: what is left of it is fitted well by many things that predict nothing.
  if (out.verdict == Verdict::kUnknownPhysics && out.unexplained > kMuch) {
    if (auto memory = describe_hysteresis(search, selection, options.threads)) {
      out.model = std::move(memory->spec);
      out.model.name = nominal.name;
      out.described_by = memory->function_of;
    }
  }
  for (MissingEffect& missing : out.missing)
    missing.probability = calibrated(missing.probability, out.unexplained, out.verdict == Verdict::kUnknownPhysics);
  out.nominal_errors.train_rmse_N = rmse(out.nominal, study.series, study.usable);
  out.model_errors.train_rmse_N = rmse(out.model, study.series, study.usable);
  out.nominal_errors.heldout_rmse_N = left_out_rmse_N(problem, out.nominal, options.threads);
  out.model_errors.heldout_rmse_N = left_out_rmse_N(problem, out.model, options.threads);
  out.heldout = study_heldout(problem, out.nominal, out.model, options.threads);
  if (out.verdict != Verdict::kConsistent)
    out.where = locate(search.instrument_problem(), out.nominal, out.model, selection.noise_scale);
  out.design = design_experiment(search, selection, options.design, options.threads);
  for (const Inseparable& pair : out.design.inseparable) out.notes.push_back(pair.text);
  note_equivalences(out.nominal, out);
  warn_of_pressures(study.series, out);
  refuse_unless_finite(out);
  return study;
}

nlohmann::ordered_json diagnosis_json(const Diagnosis& d) {
  using nlohmann::ordered_json;
  ordered_json json;
  json["format"] = "isorig-diagnosis/1";
  json["verdict"] = name_of(d.verdict);
  json["missing"] = ordered_json::array();
  for (const MissingEffect& missing : d.missing) {
    ordered_json entry;
    entry["effect"] = missing.effect->name;
    entry["probability"] = missing.probability;
    entry["size_N"] = missing.size_N;
    entry["law"] = missing.law;
    entry["side"] = model::side_of(missing.effect->stage);
    entry["parameters"] = ordered_json::object();
    for (const NamedValue& value : missing.parameters)
      entry["parameters"][value.name] = {{"value", value.value}, {"ci95", {value.low, value.high}}};
    json["missing"].push_back(std::move(entry));
  }
  json["alternatives"] = ordered_json::array();
  for (const Alternative& alternative : d.alternatives)
    json["alternatives"].push_back({{"effects", alternative.effects}, {"probability", alternative.probability}});
  json["where"] = ordered_json::array();
  for (const Place& place : d.where) {
    json["where"].push_back({{"t_start_s", place.t_start_s},
                             {"t_end_s", place.t_end_s},
                             {"covariate", place.covariate},
                             {"share", place.share},
                             {"share_ci95", {place.share_low, place.share_high}},
                             {"nominal_rmse_N", place.nominal_rmse_N},
                             {"model_rmse_N", place.model_rmse_N},
                             {"text", place.text}});
    if (!place.recording.empty()) json["where"].back()["recording"] = place.recording;
  }
  json["next_experiment"] = experiment_json(d.design);
  if (!d.design.inseparable.empty()) json["inseparable"] = inseparable_json(d.design);
  json["fit"] = {
      {"noise_N", d.noise_N},
      {"nominal",
       {{"train_rmse_N", d.nominal_errors.train_rmse_N}, {"heldout_rmse_N", d.nominal_errors.heldout_rmse_N}}},
      {"model", {{"train_rmse_N", d.model_errors.train_rmse_N}, {"heldout_rmse_N", d.model_errors.heldout_rmse_N}}}};
  json["heldout"] = ordered_json::array();
  for (const LeftOut& one : d.heldout.left_out)
    json["heldout"].push_back({{"by", one.by},
                               {"left_out", one.value},
                               {"readings", one.readings},
                               {"nominal_rmse_N", one.nominal_rmse_N},
                               {"model_rmse_N", one.model_rmse_N}});
  json["stability"] = ordered_json::array();
  for (const Stability& one : d.heldout.stability)
    json["stability"].push_back(
        {{"parameter", one.parameter}, {"value", one.value}, {"lowest", one.lowest}, {"highest", one.highest}});
  json["noise"] = {{"white_N", d.instrument.white_N},
                   {"coloured_N", d.instrument.coloured_N},
                   {"correlation_s", d.instrument.correlation_s},
                   {"source", name_of(d.noise_source)},
                   {"from_rests", d.noise_source == NoiseSource::kRests}};
  json["data_faults"] = ordered_json::array();
  for (const DataFault& fault : d.faults)
    json["data_faults"].push_back({{"kind", fault.kind},
                                   {"t_start_s", fault.t_start_s},
                                   {"t_end_s", fault.t_end_s},
                                   {"rows", fault.rows},
                                   {"text", fault.text}});
  if (!d.described_by.empty())
    json["described"] = {
        {"function_of", d.described_by},
        {"text", "structure that no effect of the catalogue explains, in few numbers or as a table in model.toml"}};
  json["unexplained_share"] = d.unexplained;
  json["bins"] = d.rows;
  json["noise_scale"] = d.noise_scale;
  json["tried"] = ordered_json::array();
  for (const Explanation& one : d.tried)
    json["tried"].push_back({{"explanation", one.key},
                             {"weight", one.weight},
                             {"log_evidence", one.log_evidence},
                             {"excess", one.excess},
                             {"at_bound", one.at_bound}});
  json["warnings"] = d.warnings;
  json["notes"] = d.notes;
  return json;
}

}  // namespace isorig::identify
