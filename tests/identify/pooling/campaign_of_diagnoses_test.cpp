// A campaign from the rig of the concealed-effect study, which shares no stepping code with the diagnosis: the real
// diagnosis of each recording, then the pool.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/formatted.hpp"
#include "base/parallel.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/pooling/pool.hpp"
#include "model/composed.hpp"
#include "proof/generator/instruments.hpp"
#include "proof/generator/motion.hpp"
#include "proof/generator/rig.hpp"

namespace isorig::identify::pooling {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::size_t kActuators = 5;
constexpr double kPressures_psi[] = {5.0, 12.0, 20.0};
constexpr int kRepetitions = 2;
constexpr double kStiffening_N_mm_psi = 0.04;

/// What is concealed in a campaign.
struct Concealed {
  double friction_N = 0.0;         ///< at 12 psi
  double friction_N_psi = 0.0;     ///< what each psi adds
  std::size_t slips = kActuators;  ///< the actuator whose grip slips; kActuators: none
};

messages::Recording record(const Concealed& concealed, std::size_t actuator, double pressure_psi, int repetition) {
  proof::Random own(20261124, "actuator " + std::to_string(actuator));
  proof::RigParameters rig;
  rig.specimen.stiffness_N_mm = 1.2 + kStiffening_N_mm_psi * pressure_psi + 0.1 * own.normal();
  rig.specimen.arms = {{1.0 + 0.05 * own.normal(), 0.6 * std::exp(0.05 * own.normal()), 1.0, 0.0}};
  rig.air.nominal_psi = pressure_psi;
  const double friction_N = concealed.friction_N * (1.0 + 0.05 * own.normal());
  rig.hidden.friction_N = friction_N + concealed.friction_N_psi * (pressure_psi - 12.0);
  proof::Random random(20261124, base::formatted("recording %zu %g %d", actuator, pressure_psi, repetition));
  proof::PaperProtocol protocol;
  protocol.velocities_mm_s = {2.0, 5.0, 10.0};
  protocol.triangle_mm = 2.0;
  protocol.slow_mm_s = 0.05;
  protocol.hold_s = 30.0;
  const proof::Motion motion = proof::paper_motion(protocol);
  if (actuator == concealed.slips && (repetition == 1 || pressure_psi > 15.0)) {
    rig.hidden.slip_mm = 0.25;
    rig.hidden.slip_at_s = motion.end_s() * random.uniform(0.55, 0.85);
  }
  messages::RecordingMetadata metadata;
  metadata.specimen = "Actuator" + std::to_string(actuator + 1);
  metadata.rest_length_mm = rig.specimen.rest_length_mm;
  metadata.pressurized_rest_length_mm = rig.specimen.pressurized_rest_length_mm;
  metadata.nominal_pressure_psi = pressure_psi;
  metadata.further_toml = "repetition = " + std::to_string(repetition) + "\n";
  return proof::measure(proof::simulate(rig, motion, {}), {}, motion.end_s(), std::move(metadata), random).recording;
}

std::vector<Source> diagnose_campaign(const Concealed& concealed, const fs::path& folder) {
  struct Cell {
    std::size_t actuator;
    double pressure_psi;
    int repetition;
  };
  std::vector<Cell> cells;
  for (std::size_t i = 0; i < kActuators; ++i)
    for (const double pressure : kPressures_psi)
      for (int k = 1; k <= kRepetitions; ++k) cells.push_back({i, pressure, k});
  std::vector<Source> out(cells.size());
  base::parallel_for(cells.size(), 2, [&](std::size_t n) {
    const auto& [actuator, pressure_psi, repetition] = cells[n];
    const auto recording = record(concealed, actuator, pressure_psi, repetition);
    DiagnosisOptions options;
    options.threads = 1;
    const Study study = diagnose({recording}, {"recording"}, model::nominal_model("slse1"), options);
    auto json = diagnosis_json(study.diagnosis);
    json["recordings"] = recordings_json({recording.metadata});
    out[n].diagnosis = folder / std::to_string(n);
    fs::create_directories(out[n].diagnosis);
    std::ofstream(out[n].diagnosis / "diagnosis.json") << json.dump();
  });
  return out;
}

const Quantity& quantity(const PooledCampaign& c, const std::string& key) {
  const auto found = std::ranges::find(c.quantities, key, &Quantity::key);
  if (found == c.quantities.end()) throw std::runtime_error("no quantity " + key);
  return *found;
}

std::vector<std::string> with(const PooledCampaign& c, const std::string& effect) {
  std::vector<std::string> out;
  for (const EffectPool& one : c.effects)
    for (std::size_t i = 0; i < c.actuators.size(); ++i)
      if (one.name == effect && one.presence.actuators[i].probability > 0.5) out.push_back(c.actuators[i]);
  return out;
}

std::vector<std::string> effects_anywhere(const PooledCampaign& c) {
  std::vector<std::string> out;
  for (const EffectPool& one : c.effects)
    if (one.presence.present() > 0) out.push_back(one.name);
  return out;
}

class CampaignOfDiagnoses : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_ = fs::path(::testing::TempDir()) /
                     ("isorig_pool_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
};

TEST_F(CampaignOfDiagnoses, FrictionGrowsAndOneActuatorSlips) {
  constexpr double kSlope_N_psi = 0.03;
  const PooledCampaign c = pool(diagnose_campaign({0.5, kSlope_N_psi, 3}, folder_));
  for (const auto& finding : c.findings) std::printf("%s\n", finding.c_str());

  EXPECT_THAT(effects_anywhere(c), ElementsAre("coulomb_friction", "grip_slip"));
  EXPECT_EQ(with(c, "coulomb_friction").size(), kActuators);
  EXPECT_THAT(with(c, "grip_slip"), ElementsAre("Actuator4"));

  const Quantity& friction = quantity(c, "coulomb_friction.force_N");
  EXPECT_EQ(friction.measurements.size(), c.recordings.size());
  EXPECT_TRUE(friction.grows);
  EXPECT_LE(friction.pooled.slope->low95, kSlope_N_psi);
  EXPECT_GE(friction.pooled.slope->high95, kSlope_N_psi);
  EXPECT_LT(friction.pooled.slope->high95 - friction.pooled.slope->low95, 0.1 * kSlope_N_psi);
  for (const Quantity& one : c.quantities) EXPECT_TRUE(one.outliers.actuators.empty()) << one.key;
  EXPECT_THAT(c.findings, Contains(HasSubstr("Dry friction is in all 5 actuators")));
  EXPECT_THAT(c.findings, Contains(HasSubstr("Slip in the grips is in Actuator4 alone")));

  // The page: every recording is there and leads to its diagnosis.
  write_pooled(c, folder_ / "pooled", {});
  const auto json = nlohmann::json::parse(std::ifstream(folder_ / "pooled" / "pooled.json"));
  EXPECT_EQ(json["recordings"].size(), c.recordings.size());
  EXPECT_GT(fs::file_size(folder_ / "pooled" / "campaign-report.html"), 10000U);
}

TEST_F(CampaignOfDiagnoses, NobodyIsNamedWhereNothingIsMissing) {
  const PooledCampaign c = pool(diagnose_campaign({}, folder_));
  for (const auto& finding : c.findings) std::printf("%s\n", finding.c_str());
  EXPECT_THAT(effects_anywhere(c), IsEmpty());
  // Beside friction, whose law is not the generator's, the spring comes out 0.7 % off, at the edge of its interval
  // (docs/pooling.md): here, where every law is right, it has to hold.
  const Quantity& spring = quantity(c, "spring.stiffness_N_mm");
  EXPECT_LE(spring.pooled.slope->low95, kStiffening_N_mm_psi);
  EXPECT_GE(spring.pooled.slope->high95, kStiffening_N_mm_psi);
  for (const Quantity& one : c.quantities) {
    EXPECT_TRUE(one.effect.empty()) << one.key;
    EXPECT_TRUE(one.outliers.actuators.empty()) << one.key;
    EXPECT_TRUE(one.outliers.recordings.empty()) << one.key;
    EXPECT_EQ(one.grows, one.key == "spring.stiffness_N_mm") << one.key;
  }
}

}  // namespace
}  // namespace isorig::identify::pooling
