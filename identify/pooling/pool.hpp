#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "identify/pooling/campaign_grid.hpp"
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

/// A diagnosis that cannot be pooled.
struct LeftOut {
  std::filesystem::path folder;
  std::string name;              ///< of its recording, for people
  std::string page;              ///< as ReadDiagnosis has it
  std::string why;               ///< without a path, and what to do
  std::optional<Place> place{};  ///< of a copy, which has one
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
  std::vector<LeftOut> left_out;
};

/// What becomes of a diagnosis that names no specimen or pressure, of a copy, of a damaged one.
enum class Unpoolable {
  kRefuse,    ///< nothing is pooled: whoever named the folders takes it out
  kLeaveOut,  ///< it is left out by name, with the reason; of copies the first one stays, where they agree on the place
};

struct PoolOptions {
  unsigned threads = 2;
  Unpoolable unpoolable = Unpoolable::kRefuse;
  /// Told which part is done, from any of the threads. What it throws ends the pool and comes out.
  std::function<void(double fraction)> on_progress{};
};

/// Throws PoolError: a folder that is no diagnosis, nominal models that differ, fewer than two recordings.
[[nodiscard]] PooledCampaign pool(const std::vector<Source>& sources, const PoolOptions& options = {});

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

/// `path` as seen from `folder`, by their names alone.
[[nodiscard]] std::string relative_to(const std::filesystem::path& folder, const std::filesystem::path& path);

/// `folder`: where pooled.json will lie, which its folders are relative to: the same bytes wherever a campaign stands.
[[nodiscard]] nlohmann::ordered_json pooled_json(const PooledCampaign& campaign, const std::filesystem::path& folder);

/// The findings, the campaign as a grid whose cells lead to the recordings' pages, and a forest of each quantity.
/// `folder`: where the page will lie, which links are relative to. `others`: recordings of the campaign that have no
/// diagnosis, for their cells.
void add_pooled_sections(report::Page& page, const PooledCampaign& campaign, const std::filesystem::path& folder,
                         const std::vector<NotPooled>& others = {});

/// pooled.json and campaign-report.html.
void write_pooled(const PooledCampaign& campaign, const std::filesystem::path& folder, const report::Made& made);

}  // namespace isorig::identify::pooling
