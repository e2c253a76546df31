#include <cmath>
#include <nlohmann/json.hpp>

#include "identify/pooling/pool.hpp"

namespace isorig::identify::pooling {
namespace {

using nlohmann::ordered_json;

ordered_json number(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json estimate_json(const Estimate& of) {
  return {{"value", number(of.value)}, {"ci95", {number(of.low95), number(of.high95)}}};
}

ordered_json place_json(const ReadDiagnosis& of) {
  ordered_json out{{"actuator", of.place.specimen}, {"pressure_psi", of.place.pressure_psi}};
  if (of.place.repetition > 0) out["repetition"] = of.place.repetition;
  return out;
}

ordered_json effect_json(const PooledCampaign& c, const EffectPool& effect) {
  const Presence& p = effect.presence;
  ordered_json out{{"effect", effect.name},  {"in_actuators", p.present()},     {"of_actuators", p.judged()},
                   {"anywhere", p.anywhere}, {"share", estimate_json(p.share)}, {"actuators", ordered_json::array()}};
  for (std::size_t i = 0; i < c.actuators.size(); ++i) {
    const auto& one = p.actuators[i];
    out["actuators"].push_back({{"actuator", c.actuators[i]},
                                {"probability", one.probability},
                                {"log_likelihood_ratio", one.log_likelihood_ratio},
                                {"recordings_named", one.named},
                                {"recordings_judged", one.judged},
                                {"recordings_that_say_nothing", one.unjudged}});
  }
  return out;
}

ordered_json outlier_json(const Outlier& of) {
  return {{"probability", of.probability},
          {"in", of.slope ? "change_with_pressure" : "value"},
          {"expected", of.expected},
          {"difference", of.difference},
          {"standard_deviations", of.deviations}};
}

ordered_json quantity_json(const PooledCampaign& c, const Quantity& q) {
  const Pooled& p = q.pooled;
  ordered_json out{{"quantity", q.key},
                   {"meaning", q.words},
                   {"unit", q.unit},
                   {"recordings", q.measurements.size()},
                   {"at_pressure_psi", p.mean_pressure_psi},
                   {"value", estimate_json(p.level)},
                   {"per_psi", nullptr},
                   {"log_evidence_of_change_with_pressure", nullptr},
                   {"changes_with_pressure", q.grows},
                   {"spread",
                    {{"actuators", estimate_json(p.level_sd)},
                     {"actuators_per_psi", estimate_json(p.slope_sd)},
                     {"actuator_and_pressure", estimate_json(p.cell_sd)},
                     {"repetitions", estimate_json(p.repetition_sd)}}},
                   {"actuators", ordered_json::array()},
                   {"outlying_actuators", ordered_json::array()},
                   {"outlying_recordings", ordered_json::array()}};
  if (p.slope) out["per_psi"] = estimate_json(*p.slope);
  if (p.log_evidence_of_slope) out["log_evidence_of_change_with_pressure"] = *p.log_evidence_of_slope;
  for (std::size_t i = 0; i < p.actuators.size(); ++i) {
    const auto& one = p.actuators[i];
    if (one.measurements == 0) continue;
    out["actuators"].push_back({{"actuator", c.actuators[i]},
                                {"recordings", one.measurements},
                                {"value", estimate_json(one.level)},
                                {"per_psi", one.slope ? estimate_json(*one.slope) : ordered_json(nullptr)},
                                {"alone", number(one.unpooled_level)},
                                {"alone_standard_error", number(one.unpooled_error)}});
  }
  for (const Outlier& one : q.outliers.actuators) {
    ordered_json entry{{"actuator", c.actuators[one.index]}};
    entry.update(outlier_json(one));
    out["outlying_actuators"].push_back(std::move(entry));
  }
  for (const Outlier& one : q.outliers.recordings) {
    ordered_json entry = place_json(c.recordings[q.recording[one.index]]);
    entry.update(outlier_json(one));
    out["outlying_recordings"].push_back(std::move(entry));
  }
  return out;
}

}  // namespace

ordered_json pooled_json(const PooledCampaign& c, const std::filesystem::path& folder) {
  ordered_json out{{"format", "isorig-pooled/1"},
                   {"findings", c.findings},
                   {"actuators", c.actuators},
                   {"pressures_psi", c.pressures_psi},
                   {"recordings", ordered_json::array()},
                   {"effects", ordered_json::array()},
                   {"quantities", ordered_json::array()},
                   {"not_compared", c.not_compared},
                   {"left_out", ordered_json::array()}};
  for (const ReadDiagnosis& one : c.recordings) {
    ordered_json entry = place_json(one);
    entry["folder"] = relative_to(folder, one.folder);
    entry["verdict"] = one.verdict;
    entry["missing"] = ordered_json::array();
    for (const ReadEffect& effect : one.missing)
      entry["missing"].push_back({{"effect", effect.name}, {"probability", effect.probability}});
    out["recordings"].push_back(std::move(entry));
  }
  for (const EffectPool& effect : c.effects) out["effects"].push_back(effect_json(c, effect));
  for (const Quantity& one : c.quantities) out["quantities"].push_back(quantity_json(c, one));
  for (const LeftOut& one : c.left_out)
    out["left_out"].push_back({{"recording", one.name}, {"folder", relative_to(folder, one.folder)}, {"why", one.why}});
  return out;
}

}  // namespace isorig::identify::pooling
