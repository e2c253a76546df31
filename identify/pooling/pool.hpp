#pragma once
#include <optional>
#include <string>
#include <vector>

#include "identify/pooling/evidence.hpp"
#include "identify/pooling/outliers.hpp"
#include "identify/pooling/read_diagnosis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify::pooling {

/// A number that several recordings have, pooled.
struct Quantity {
  std::string key;     ///< "coulomb_friction.force_N", "spring.stiffness_N_mm"
  std::string effect;  ///< of a named effect; empty: of the nominal model
  std::string words;   ///< "dry friction: friction force at steady sliding"
  std::string unit;    ///< "N/mm"; empty of a ratio
  std::vector<Measurement> measurements;
  std::vector<std::size_t> recording;  ///< of each measurement
  std::vector<std::string> law;        ///< of each measurement, that the effect has there; empty of the nominal model
  Pooled pooled;
  Outliers outliers;
  bool grows = false;  ///< the slope's interval excludes zero, and the evidence for it is at least three to one
};

/// An effect that some recording names, or could have.
struct EffectPool {
  std::string name, words;
  bool event = false;
  std::vector<double> probability;  ///< of each recording; NaN where it says nothing
  Presence presence;
};

struct PooledCampaign {
  std::vector<ReadDiagnosis> recordings;  ///< by actuator, pressure, repetition
  std::vector<std::size_t> actuator_of;   ///< of each recording
  std::vector<std::string> actuators;     ///< in the order that people count in
  std::vector<double> pressures_psi;
  std::vector<EffectPool> effects;  ///< those that some actuator has first, by how many
  std::vector<Quantity> quantities;
  std::vector<std::string> not_compared;  ///< which numbers are in no pool, and why
  std::vector<std::string> findings;      ///< in plain English, most important first
};

/// Throws PoolError: a folder that is no diagnosis, nominal models that differ, fewer than two recordings.
[[nodiscard]] PooledCampaign pool(const std::vector<Source>& sources, unsigned threads = 2);

/// Chooses the numbers that several recordings have and that mean the same in all; not pooled yet.
[[nodiscard]] std::vector<Quantity> choose_quantities(const PooledCampaign& campaign,
                                                      std::vector<std::string>& not_compared);

/// An error of the law that is the same in all recordings of a pressure does not average out, and no recording's
/// interval contains it: such intervals hold the true value for six of seven numbers (docs/proof.md), as if to each
/// standard error 0.89 of it were added that recordings share. The pooled level and slope are widened by that, and so
/// are those of every actuator, which it moves as far. Differences between actuators do not have it.
void widen_by_law_error(Quantity& quantity);

[[nodiscard]] std::vector<std::string> findings_of(const PooledCampaign& campaign);

/// "Actuator7, 10 psi, repetition 3".
[[nodiscard]] std::string name_of(const ReadDiagnosis& recording);

/// "0.12 ± 0.02": the digits that half of a 95 % interval leaves.
[[nodiscard]] std::string plus_minus(double value, double half_width);

[[nodiscard]] nlohmann::ordered_json pooled_json(const PooledCampaign& campaign);

/// The findings, the campaign as a grid whose cells lead to the recordings' pages, and a forest of each quantity.
/// `folder`: where the page will lie, which links are relative to.
void add_pooled_sections(report::Page& page, const PooledCampaign& campaign, const std::filesystem::path& folder);

/// pooled.json and campaign-report.html.
void write_pooled(const PooledCampaign& campaign, const std::filesystem::path& folder, const report::Made& made);

}  // namespace isorig::identify::pooling
