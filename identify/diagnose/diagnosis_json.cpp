#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "identify/diagnose/claims_json.hpp"
#include "identify/diagnose/deciding/deciding_table.hpp"
#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {
namespace {

using nlohmann::ordered_json;

ordered_json missing_json(const std::vector<MissingEffect>& missing) {
  ordered_json list = ordered_json::array();
  for (const MissingEffect& one : missing) {
    ordered_json entry;
    entry["effect"] = one.effect->name;
    entry["probability"] = one.probability;
    entry["weight"] = one.weight;
    entry["size_N"] = one.size_N;
    entry["law"] = one.law;
    entry["side"] = model::side_of(one.effect->stage);
    entry["acts_on"] = one.effect->traits.acts_on;
    entry["depends_on"] = one.effect->traits.depends_on;
    entry["formula"] = one.formula;
    entry["shape"] = {{"of", one.shape.of},
                      {"x", one.shape.x},
                      {"y", one.shape.y},
                      {"low95", one.shape.low95},
                      {"high95", one.shape.high95}};
    entry["parameters"] = ordered_json::object();
    for (const NamedValue& value : one.parameters)
      entry["parameters"][value.key()] = {{"value", value.value}, {"ci95", {value.low, value.high}}};
    list.push_back(std::move(entry));
  }
  return list;
}

ordered_json discovered_json(const std::vector<DiscoveredLaw>& discovered) {
  ordered_json list = ordered_json::array();
  for (const DiscoveredLaw& one : discovered) {
    ordered_json entry{{"law", one.law},
                       {"acts_on", one.acts_on},
                       {"depends_on", one.depends_on},
                       {"formula", one.formula},
                       {"in_words", one.in_words},
                       {"inclusion_probability", one.inclusion_probability},
                       {"parameters", ordered_json::object()}};
    for (const NamedValue& value : one.parameters)
      entry["parameters"][value.key()] = {{"value", value.value}, {"ci95", {value.low, value.high}}};
    list.push_back(std::move(entry));
  }
  return list;
}

ordered_json places_json(const std::vector<Place>& where) {
  ordered_json list = ordered_json::array();
  for (const Place& place : where) {
    list.push_back({{"t_start_s", place.t_start_s},
                    {"t_end_s", place.t_end_s},
                    {"covariate", place.covariate},
                    {"share", place.share},
                    {"share_ci95", {place.share_low, place.share_high}},
                    {"nominal_rmse_N", place.nominal_rmse_N},
                    {"model_rmse_N", place.model_rmse_N},
                    {"text", place.text}});
    if (!place.recording.empty()) list.back()["recording"] = place.recording;
  }
  return list;
}

ordered_json errors_json(const Errors& of) {
  ordered_json out{{"train_rmse_N", of.train_rmse_N}, {"heldout_rmse_N", nullptr}};
  if (of.heldout_rmse_N) out["heldout_rmse_N"] = *of.heldout_rmse_N;
  return out;
}

ordered_json left_out_json(const LeftOut& one) {
  return {{"by", one.by},
          {"left_out", one.value},
          {"readings", one.readings},
          {"nominal_rmse_N", one.nominal_rmse_N},
          {"model_rmse_N", one.model_rmse_N}};
}

ordered_json numbers_json(const model::ModelSpec& spec, const std::vector<std::vector<NamedValue>>& numbers) {
  ordered_json list = ordered_json::array();
  for (std::size_t p = 0; p < numbers.size(); ++p)
    for (const NamedValue& value : numbers[p])
      list.push_back({{"part", spec.parts[p].physics->name},
                      {"number", value.name},
                      {"value", value.value},
                      {"ci95", {value.low, value.high}}});
  return list;
}

/// Of many blocks those that the model predicts worst, in the order of time: the file stays small.
ordered_json blocks_json(std::vector<BlockError> blocks) {
  constexpr std::size_t kMost = 400;
  if (blocks.size() > kMost) {
    std::ranges::stable_sort(blocks, std::greater<>(), &BlockError::model_rmse_N);
    blocks.resize(kMost);
    std::ranges::stable_sort(blocks, {}, [](const BlockError& b) { return std::pair(b.series, b.t_start_s); });
  }
  ordered_json list = ordered_json::array();
  for (const BlockError& one : blocks)
    list.push_back({{"recording", one.recording},
                    {"t_start_s", one.t_start_s},
                    {"t_end_s", one.t_end_s},
                    {"readings", one.readings},
                    {"nominal_rmse_N", one.nominal_rmse_N},
                    {"model_rmse_N", one.model_rmse_N}});
  return list;
}

/// What each model predicts of the readings that it was not fitted to.
void add_heldout(ordered_json& json, const Diagnosis& d) {
  json["heldout"] = ordered_json::array();
  for (const LeftOut& one : d.heldout.left_out) json["heldout"].push_back(left_out_json(one));
  json["heldout_each"] = blocks_json(d.heldout.each_block);
  json["model_share"] = d.model_share;
  json["not_modelled"] = nullptr;
  if (!d.not_modelled.why.empty()) {
    json["not_modelled"] = {{"names", d.not_modelled.names}, {"why", d.not_modelled.why}, {"decided_by", nullptr}};
    if (d.not_modelled.decided_by) json["not_modelled"]["decided_by"] = left_out_json(*d.not_modelled.decided_by);
  }
  json["stability"] = ordered_json::array();
  for (const Stability& one : d.heldout.stability)
    json["stability"].push_back(
        {{"parameter", one.parameter}, {"value", one.value}, {"lowest", one.lowest}, {"highest", one.highest}});
}

ordered_json data_faults_json(const std::vector<DataFault>& faults) {
  ordered_json list = ordered_json::array();
  for (const DataFault& fault : faults)
    list.push_back({{"kind", fault.kind},
                    {"t_start_s", fault.t_start_s},
                    {"t_end_s", fault.t_end_s},
                    {"rows", fault.rows},
                    {"text", fault.text}});
  return list;
}

ordered_json discernible_json(const std::vector<Discernible>& discernible) {
  ordered_json list = ordered_json::array();
  for (const Discernible& one : discernible) {
    ordered_json entry{{"effect", one.effect->name},
                       {"law", one.law->name},
                       {"seen_from_N", nullptr},
                       {"nearest", nullptr},
                       {"told_from_N", nullptr}};
    if (std::isfinite(one.seen_from_N)) entry["seen_from_N"] = one.seen_from_N;
    if (one.nearest != nullptr) entry["nearest"] = one.nearest->name;
    if (std::isfinite(one.told_from_N)) entry["told_from_N"] = one.told_from_N;
    list.push_back(std::move(entry));
  }
  return list;
}

ordered_json tried_json(const std::vector<Explanation>& tried) {
  ordered_json list = ordered_json::array();
  for (const Explanation& one : tried)
    list.push_back({{"explanation", one.key},
                    {"weight", one.weight},
                    {"log_evidence", one.log_evidence},
                    {"excess", one.excess},
                    {"left_noises", one.left},
                    {"at_bound", one.at_bound}});
  return list;
}

}  // namespace

ordered_json diagnosis_json(const Diagnosis& d) {
  ordered_json json;
  json["format"] = "isorig-diagnosis/1";
  json["verdict"] = name_of(d.verdict);
  json["cannot_judge"] = nullptr;
  if (d.unjudged) json["cannot_judge"] = {{"why", d.unjudged->why}, {"record", d.unjudged->record}};
  json["missing"] = missing_json(d.missing);
  json["alternatives"] = ordered_json::array();
  for (const Alternative& alternative : d.alternatives)
    json["alternatives"].push_back({{"effects", alternative.effects}, {"probability", alternative.probability}});
  json["where"] = places_json(d.where);
  json["next_experiment"] = experiment_json(d.design);
  if (!d.design.inseparable.empty()) json["inseparable"] = inseparable_json(d.design);
  json["fit"] = {{"noise_N", d.noise_N},
                 {"heldout_blocks", name_of(d.heldout.blocks)},
                 {"nominal", errors_json(d.nominal_errors)},
                 {"model", errors_json(d.model_errors)}};
  json["fit"]["nominal"]["numbers"] = numbers_json(d.nominal, d.nominal_numbers);
  json["fit"]["model"]["numbers"] = numbers_json(d.model, d.model_numbers);
  add_heldout(json, d);
  json["noise"] = {{"white_N", d.instrument.white_N},
                   {"coloured_N", d.instrument.coloured_N},
                   {"correlation_s", d.instrument.correlation_s},
                   {"source", name_of(d.noise_source)},
                   {"from_rests", d.noise_source == NoiseSource::kRests}};
  if (d.noise_reading_s > 0.0) json["noise"]["correlation_readings"] = d.instrument.correlation_s / d.noise_reading_s;
  if (d.walk)
    json["zero_walk"] = {{"rms_N_per_sqrt_s", d.walk->rms_N(1.0)},
                         {"rest_rms_N_per_sqrt_s", std::sqrt(d.walk->rest_rate_N2_s)},
                         {"motion_rms_N_per_sqrt_s", std::sqrt(d.walk->motion_rate_N2_s)},
                         {"log_odds_at_rest", d.walk->log_odds_nats}};
  json["data_faults"] = data_faults_json(d.faults);
  json["discernible"] = discernible_json(d.discernible);
  if (!d.described_by.empty())
    json["described"] = {
        {"function_of", d.described_by},
        {"text", "structure that no effect of the catalogue explains, in few numbers or as a table in model.toml"}};
  json["discovered"] = discovered_json(d.discovered);
  json["unexplained_share"] = d.unexplained;
  json["bins"] = d.rows;
  json["noise_scale"] = d.noise_scale;
  json["tried"] = tried_json(d.tried);
  if (d.reliability) json["name_check"] = reliability_json(*d.reliability);
  if (!d.decided.empty()) json["deciding"] = changed_json(d.decided);
  json["warnings"] = d.warnings;
  json["notes"] = d.notes;
  return json;
}

}  // namespace isorig::identify
