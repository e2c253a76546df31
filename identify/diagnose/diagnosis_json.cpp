#include <cmath>
#include <nlohmann/json.hpp>

#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {

nlohmann::ordered_json diagnosis_json(const Diagnosis& d) {
  using nlohmann::ordered_json;
  ordered_json json;
  json["format"] = "isorig-diagnosis/1";
  json["verdict"] = name_of(d.verdict);
  json["cannot_judge"] = nullptr;
  if (d.unjudged) json["cannot_judge"] = {{"why", d.unjudged->why}, {"record", d.unjudged->record}};
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
  const auto errors = [](const Errors& of) {
    ordered_json out{{"train_rmse_N", of.train_rmse_N}, {"heldout_rmse_N", nullptr}};
    if (of.heldout_rmse_N) out["heldout_rmse_N"] = *of.heldout_rmse_N;
    return out;
  };
  json["fit"] = {{"noise_N", d.noise_N},
                 {"heldout_blocks", name_of(d.heldout.blocks)},
                 {"nominal", errors(d.nominal_errors)},
                 {"model", errors(d.model_errors)}};
  const auto row = [](const LeftOut& one) {
    return ordered_json{{"by", one.by},
                        {"left_out", one.value},
                        {"readings", one.readings},
                        {"nominal_rmse_N", one.nominal_rmse_N},
                        {"model_rmse_N", one.model_rmse_N}};
  };
  json["heldout"] = ordered_json::array();
  for (const LeftOut& one : d.heldout.left_out) json["heldout"].push_back(row(one));
  json["not_modelled"] = nullptr;
  if (!d.not_modelled.why.empty()) {
    json["not_modelled"] = {{"names", d.not_modelled.names}, {"why", d.not_modelled.why}, {"decided_by", nullptr}};
    if (d.not_modelled.decided_by) json["not_modelled"]["decided_by"] = row(*d.not_modelled.decided_by);
  }
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
  json["discernible"] = ordered_json::array();
  for (const Discernible& one : d.discernible) {
    ordered_json entry{{"effect", one.effect->name},
                       {"law", one.law->name},
                       {"seen_from_N", nullptr},
                       {"nearest", nullptr},
                       {"told_from_N", nullptr}};
    if (std::isfinite(one.seen_from_N)) entry["seen_from_N"] = one.seen_from_N;
    if (one.nearest != nullptr) entry["nearest"] = one.nearest->name;
    if (std::isfinite(one.told_from_N)) entry["told_from_N"] = one.told_from_N;
    json["discernible"].push_back(std::move(entry));
  }
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
