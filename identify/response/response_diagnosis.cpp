#include "identify/response/response_diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/number_text.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/deciding/deciding_table.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify::response {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t kStretches = 5;

std::size_t numbers_of(const Structure& s, std::size_t inputs, std::size_t recordings) {
  if (inputs == 0) return recordings * (s.exponent ? 1 : s.times) + s.times + 1 + (s.exponent ? 1 : 0);
  return recordings * (1 + s.times) + s.times + inputs * (1 + s.times + (s.play ? 2 : 0)) + (s.drift ? 1 : 0);
}

std::vector<Structure> explanations(std::size_t nominal_times, std::size_t inputs) {
  constexpr std::size_t kFurther = 2;
  std::vector<Structure> out;
  for (std::size_t times = nominal_times; times <= nominal_times + kFurther; ++times) {
    if (inputs == 0) {
      out.push_back({.times = times});
      continue;
    }
    for (const bool play : {false, true})
      for (const bool drift : {false, true}) out.push_back({.times = times, .play = play, .drift = drift});
  }
  if (inputs == 0 && nominal_times == 1) out.push_back({.times = 1, .exponent = true});
  return out;
}

std::vector<std::string> effects_of(const Structure& s, std::size_t nominal_times) {
  std::vector<std::string> out;
  if (s.times > nominal_times) out.emplace_back("second_relaxation");
  if (s.play) out.emplace_back("coulomb_friction");
  if (s.drift) out.emplace_back("zero_drift");
  if (s.exponent) out.emplace_back("nonlinear_viscosity");
  return out;
}

std::string formula_of(const std::string& effect, const ResponseModel& model) {
  const auto number = [](double value) { return base::number_text(value, 3); };
  if (effect == "second_relaxation") {
    std::string text = "answers within ";
    for (std::size_t i = 0; i < model.times_s.size(); ++i)
      text += (i == 0 ? "" : i + 1 == model.times_s.size() ? " and " : ", ") + number(model.times_s[i]) + " s";
    return text;
  }
  if (effect == "coulomb_friction") {
    std::string text;
    for (const auto& input : model.inputs)
      text += (text.empty() ? "" : "; ") + number(input.play_gain) + " play(" + input.column + ", " +
              number(input.play_width) + ")";
    return text;
  }
  if (effect == "zero_drift") return number(model.drift_per_h) + " per hour";
  return "q' = -q |q / " + number(model.scale) + "|^" + number(model.exponent - 1.0) + " / " +
         number(model.times_s[0]) + " s, q = y - " + number(model.rest);
}

/// Which numbers say how large an effect is.
bool belongs(const std::string& effect, const std::string& number) {
  if (effect == "second_relaxation") return number.starts_with("time_") || number.starts_with("retarded_");
  if (effect == "coulomb_friction") return number.starts_with("play_");
  if (effect == "zero_drift") return number.starts_with("drift_");
  return number == "exponent" || number.starts_with("time_") || number.starts_with("rest_");
}

/// Row k of n lies in this stretch.
std::size_t stretch_of(std::size_t k, std::size_t n) {
  return std::min(kStretches * k / n, kStretches - 1);
}

double rms_within(const ResponseFit& fit, std::size_t r, std::size_t stretch) {
  const auto& residual = fit.residual[r];
  double squares = 0.0, rows = 0.0;
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    if (stretch_of(static_cast<std::size_t>(k), static_cast<std::size_t>(residual.size())) != stretch) continue;
    squares += residual[k] * residual[k];
    rows += 1.0;
  }
  return std::sqrt(squares / std::max(1.0, rows));
}

/// Each stretch of all recordings left out in turn. The first says where a recording begins and what its units still
/// had to go, which no other stretch can: it stays in.
void leave_out(const std::vector<Data>& data, const ResponseFit& nominal, const ResponseFit& chosen,
               ResponseDiagnosis& out) {
  double nominal_squares = 0.0, model_squares = 0.0, rows = 0.0;
  for (std::size_t stretch = 1; stretch < kStretches; ++stretch) {
    std::vector<std::vector<bool>> used;
    for (const Data& each : data) {
      used.emplace_back(each.t_s.size());
      for (std::size_t k = 0; k < each.t_s.size(); ++k) used.back()[k] = stretch_of(k, each.t_s.size()) != stretch;
    }
    const ResponseFit without = fit_response(data, nominal.structure, used, &nominal);
    const ResponseFit with =
        nominal.structure == chosen.structure ? without : fit_response(data, chosen.structure, used, &chosen);
    for (std::size_t r = 0; r < data.size(); ++r) {
      const auto n = data[r].t_s.size();
      const auto from = (stretch * n + kStretches - 1) / kStretches,
                 to = ((stretch + 1) * n + kStretches - 1) / kStretches;
      LeftOutPart part{data[r].t_s[from],
                       data[r].t_s[std::min(to, n) - 1],
                       data[r].name,
                       rms_within(without, r, stretch),
                       rms_within(with, r, stretch),
                       r,
                       from,
                       {},
                       {}};
      for (std::size_t k = from; k < to; ++k) {
        part.nominal_residual.push_back(without.residual[r][static_cast<Eigen::Index>(k)]);
        part.model_residual.push_back(with.residual[r][static_cast<Eigen::Index>(k)]);
      }
      const auto count = static_cast<double>(to - from);
      nominal_squares += count * part.nominal_rms * part.nominal_rms;
      model_squares += count * part.model_rms * part.model_rms;
      rows += count;
      out.left_out.push_back(std::move(part));
    }
  }
  out.nominal_heldout = std::sqrt(nominal_squares / rows);
  out.model_heldout = std::sqrt(model_squares / rows);
}

double variance_of(const std::vector<Data>& data) {
  double squares = 0.0, rows = 0.0;
  for (const Data& each : data) {
    double mean = 0.0;
    for (const double y : each.output_value) mean += y / static_cast<double>(each.output_value.size());
    for (const double y : each.output_value) squares += (y - mean) * (y - mean);
    rows += static_cast<double>(each.output_value.size());
  }
  return squares / rows;
}

double noise_of(const std::vector<Data>& data) {
  double squares = 0.0;
  for (const Data& each : data) {
    const double worst = std::max(each.output_quality.noise, each.output_quality.rounding());
    squares += worst * worst / static_cast<double>(data.size());
  }
  // Numbers of a simulation have none: what a search leaves by its tolerance is no structure.
  constexpr double kTolerance = 1e-6;
  return std::hypot(std::sqrt(squares), kTolerance * std::sqrt(variance_of(data)));
}

/// The same bars as where the force is the output (diagnosis.cpp, judgeable.cpp).
void decide_verdict(ResponseDiagnosis& out) {
  const double noise2 = out.noise * out.noise;
  const double before = out.nominal.rms * out.nominal.rms - noise2, left = out.model.rms * out.model.rms - noise2;
  out.unexplained = before > 0.0 ? std::clamp(left / before, 0.0, 1.0) : 0.0;
  const bool structure_left = left > deciding().structure_share * noise2;
  if (out.model.rms * out.model.rms > deciding().most_variance_left_share * variance_of(out.data)) {
    out.verdict = "cannot_judge";
    out.why = "no model that was tried explains more than " +
              base::number_text(100.0 * (1.0 - out.model.rms * out.model.rms / variance_of(out.data)), 2) +
              " % of the variance of the " + std::string(messages::name_of(out.output));
    out.record = "what else drives the output as a column of its own, with steps that are held until nothing changes";
    out.missing.clear();
    out.model = out.nominal;
  } else if (structure_left && (out.missing.empty() || out.unexplained > deciding().much_unexplained_share)) {
    out.verdict = "unknown_physics";
  } else {
    out.verdict = out.missing.empty() ? "consistent" : "missing_physics";
  }
  for (MissingPart& missing : out.missing)
    missing.probability = calibrated(missing.probability, out.unexplained, out.verdict == "unknown_physics");
}

std::size_t rows_of(const std::vector<Data>& data) {
  std::size_t rows = 0;
  for (const Data& each : data) rows += each.t_s.size();
  return rows;
}

/// Every explanation, the nominal model first, with its evidence. One number of independent rows for all, that of the
/// least residual: else a model that explains less would be weighed as if it had fewer readings.
std::vector<ResponseFit> weigh(const ResponseDiagnosis& of, std::size_t nominal_times,
                               const std::function<void(double, const char*)>& now) {
  constexpr std::size_t kRowsPerNumber = 3;
  const std::size_t inputs = of.data[0].inputs.size();
  const auto all = explanations(nominal_times, inputs);
  std::vector<ResponseFit> fits;
  for (std::size_t i = 0; i < all.size(); ++i) {
    now(0.85 * static_cast<double>(i) / static_cast<double>(all.size()), "weighing what may be missing");
    if (i > 0 && kRowsPerNumber * numbers_of(all[i], inputs, of.data.size()) > rows_of(of.data)) continue;
    Structure fewer = all[i];
    --fewer.times;
    const auto before = std::ranges::find(fits, fewer, &ResponseFit::structure);
    fits.push_back(fit_response(of.data, all[i], {}, before == fits.end() ? nullptr : &*before));
  }
  const auto least = std::ranges::min_element(fits, {}, &ResponseFit::rms);
  const double rows = independent_rows(least->residual);
  for (ResponseFit& fit : fits) {
    const double k = static_cast<double>(numbers_of(fit.structure, inputs, of.data.size()));
    const double floor = 0.1 * of.noise;  // no fit is better than that for a reason
    fit.log_evidence = -rows * std::log(std::hypot(fit.rms, floor)) - 0.5 * k * std::log(rows);
  }
  return fits;
}

/// Weights of the sets of effects, their probabilities, and which fit is the best.
std::size_t choose(const std::vector<ResponseFit>& fits, std::size_t nominal_times, ResponseDiagnosis& out) {
  const auto best = std::ranges::max_element(fits, {}, &ResponseFit::log_evidence);
  double sum = 0.0;
  for (const ResponseFit& fit : fits) sum += std::exp(fit.log_evidence - best->log_evidence);
  std::map<std::string, double> probability;
  for (const ResponseFit& fit : fits) {
    const double weight = std::exp(fit.log_evidence - best->log_evidence) / sum;
    const auto effects = effects_of(fit.structure, nominal_times);
    for (const std::string& effect : effects) probability[effect] += weight;
    const auto same = std::ranges::find(out.tried, effects, &ResponseDiagnosis::Tried::effects);
    if (same == out.tried.end())
      out.tried.push_back({effects, weight});
    else
      same->weight += weight;
  }
  std::ranges::stable_sort(out.tried, std::greater<>(), &ResponseDiagnosis::Tried::weight);
  for (const std::string& effect : effects_of(best->structure, nominal_times))
    out.missing.push_back({effect, probability[effect], formula_of(effect, best->model), {}});
  return static_cast<std::size_t>(best - fits.begin());
}

/// As of a force (diagnosis.cpp).
void name_nothing_of_few_rows(ResponseDiagnosis& out) {
  constexpr std::size_t kFewestToName = 100;
  if (rows_of(out.data) >= kFewestToName || out.missing.empty()) return;
  std::string found;
  for (const MissingPart& one : out.missing) found += (found.empty() ? "" : " + ") + one.effect;
  out.verdict = "cannot_judge";
  out.why = "something speaks for " + found + ", and " + std::to_string(rows_of(out.data)) +
            " rows leave nothing to check it by";
  out.record = "the same with at least " + std::to_string(kFewestToName) + " rows";
  out.missing.clear();
  out.model = out.nominal;
}

void refuse_unless_finite(const ResponseDiagnosis& d) {
  bool finite = std::isfinite(d.nominal.rms) && std::isfinite(d.model.rms) && std::isfinite(*d.nominal_heldout) &&
                std::isfinite(*d.model_heldout);
  for (const MissingPart& one : d.missing)
    for (const FittedNumber& number : one.numbers) finite = finite && std::isfinite(number.value);
  if (!finite)
    throw std::domain_error(
        "the diagnosis did not come out in finite numbers, so there is no verdict; look at the recordings for values "
        "that cannot be meant");
}

}  // namespace

ResponseDiagnosis diagnose_response(const std::vector<messages::Recording>& recordings,
                                    const std::vector<std::string>& names, std::string_view nominal,
                                    const std::function<void(double, const char*)>& on_progress) {
  if (nominal != "slse1" && nominal != "slse2")
    throw std::invalid_argument(std::string(nominal) +
                                ": the nominal model of a position or a pressure is slse1 or slse2, one retardation "
                                "time or two; a model file describes a force");
  const auto now = [&](double fraction, const char* doing) {
    if (on_progress) on_progress(fraction, doing);
  };
  refuse_repeated(recordings, names);
  ResponseDiagnosis out;
  std::vector<std::string> specimens;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    out.data.push_back(data_of(recordings[i], names[i]));
    specimens.push_back(recordings[i].metadata.specimen);
  }
  measure_outputs(out.data);
  require_one_question(out.data);
  if (const auto changed = decided(); !changed.empty()) out.warnings.push_back(decided_text(changed));
  if (auto text = several_specimens(specimens); !text.empty()) out.warnings.push_back(std::move(text));
  out.output = out.data[0].output;
  out.noise = noise_of(out.data);
  const std::size_t nominal_times = nominal == "slse2" ? 2 : 1;
  const std::vector<ResponseFit> fits = weigh(out, nominal_times, now);
  const std::size_t chosen = choose(fits, nominal_times, out);
  out.nominal = fits[0];
  out.model = fits[chosen];
  for (MissingPart& missing : out.missing)
    for (const FittedNumber& number : out.model.numbers)
      if (belongs(missing.effect, number.name)) missing.numbers.push_back(number);
  decide_verdict(out);
  name_nothing_of_few_rows(out);
  now(0.85, "predicting what was left out");
  leave_out(out.data, out.nominal, out.model, out);
  if (!(*out.model_heldout <= *out.nominal_heldout)) {
    out.not_modelled = "without it readings that were left out are predicted better (" +
                       base::number_text(*out.nominal_heldout, 3) + " against " +
                       base::number_text(*out.model_heldout, 3) + " " + std::string(unit_of(out.output)) + ")";
    for (MissingPart& missing : out.missing) missing.probability = stated_if_refused(missing.probability);
    out.model = out.nominal;
    out.model_heldout = out.nominal_heldout;
  }
  if (out.model.at_bound)
    out.notes.emplace_back(
        "A number of the model stands at the end of what was searched (times from three rows to three "
        "times the recording): it is no better known than that.");
  out.nominal.model.name = out.model.model.name = std::string(nominal);
  out.nominal.model.error = *out.nominal_heldout;
  out.model.model.error = *out.model_heldout;
  refuse_unless_finite(out);
  return out;
}

ordered_json response_json(const ResponseDiagnosis& d) {
  const std::string unit(unit_of(d.output));
  ordered_json json;
  json["format"] = "isorig-diagnosis/1";
  json["output"] = messages::name_of(d.output);
  json["verdict"] = d.verdict;
  json["cannot_judge"] = nullptr;
  if (!d.why.empty()) json["cannot_judge"] = {{"why", d.why}, {"record", d.record}};
  json["missing"] = ordered_json::array();
  for (const MissingPart& one : d.missing) {
    const model::Physics* physics = model::find_physics(one.effect);
    ordered_json entry{{"effect", one.effect}, {"probability", one.probability}, {"formula", one.formula}};
    if (physics != nullptr) entry["depends_on"] = physics->traits.depends_on;
    entry["parameters"] = ordered_json::object();
    for (const FittedNumber& number : one.numbers)
      entry["parameters"][number.name] = {{"value", number.value}, {"ci95", {number.low95, number.high95}}};
    json["missing"].push_back(std::move(entry));
  }
  json["alternatives"] = ordered_json::array();
  constexpr double kLeastWeight = 0.005;
  for (std::size_t i = 1; i < d.tried.size(); ++i)
    if (d.tried[i].weight >= kLeastWeight)
      json["alternatives"].push_back({{"effects", d.tried[i].effects}, {"probability", d.tried[i].weight}});
  json["where"] = ordered_json::array();
  const auto excess = [&](const LeftOutPart& part) {
    return std::max(0.0, part.nominal_rms * part.nominal_rms - d.noise * d.noise);
  };
  double all = 0.0;
  for (const LeftOutPart& part : d.left_out) all += excess(part);
  std::vector<LeftOutPart> worst_first = d.left_out;
  std::ranges::stable_sort(worst_first, std::greater<>(), &LeftOutPart::nominal_rms);
  for (const LeftOutPart& part : worst_first) {
    if (d.verdict == "consistent" || !(excess(part) > 0.0)) continue;
    const double share = excess(part) / all;
    json["where"].push_back(
        {{"t_start_s", part.from_s},
         {"t_end_s", part.to_s},
         {"covariate", "time"},
         {"share", share},
         {"text", base::number_text(100.0 * share, 2) + " % of what the nominal model leaves of " +
                      "readings that it was not fitted to lies between " + base::number_text(part.from_s, 4) + " and " +
                      base::number_text(part.to_s, 4) + " s"},
         {"recording", part.recording},
         {"nominal_rmse_" + unit, part.nominal_rms},
         {"model_rmse_" + unit, part.model_rms}});
  }
  json["next_experiment"] = nullptr;
  const auto errors = [&](const ResponseFit& fit, const std::optional<double>& heldout) {
    ordered_json out{{"train_rmse_" + unit, fit.rms}, {"heldout_rmse_" + unit, nullptr}};
    if (heldout) out["heldout_rmse_" + unit] = *heldout;
    return out;
  };
  json["fit"] = {{"noise_" + unit, d.noise},
                 {"nominal", errors(d.nominal, d.nominal_heldout)},
                 {"model", errors(d.model, d.model_heldout)}};
  json["not_modelled"] = nullptr;
  if (!d.not_modelled.empty()) {
    json["not_modelled"] = {{"names", ordered_json::array()}, {"why", d.not_modelled}, {"decided_by", nullptr}};
    for (const MissingPart& one : d.missing) json["not_modelled"]["names"].push_back(one.effect);
  }
  json["unexplained_share"] = d.unexplained;
  if (const auto changed = decided(); !changed.empty()) json["deciding"] = changed_json(changed);
  json["warnings"] = d.warnings;
  json["notes"] = d.notes;
  return json;
}

}  // namespace isorig::identify::response
