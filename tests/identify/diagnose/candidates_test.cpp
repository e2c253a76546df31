// The experiments that may be asked for, and what they will look like once recorded.
#include "identify/diagnose/design/candidates.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/toml_reader.hpp"
#include "identify/diagnose/design/rehearse.hpp"

namespace isorig::identify {
namespace {

CandidateLimits rig() {
  CandidateLimits limits;
  limits.rig.travel_min_mm = -5.0;
  limits.rig.travel_max_mm = 5.0;
  limits.rig.speed_min_mm_s = 0.01;
  limits.rig.speed_max_mm_s = 10.0;
  limits.rig.force_min_N = -5.0;
  limits.rig.force_max_N = 100.0;
  limits.rig.pressure_max_psi = 30.0;
  limits.rig.pressure_rate_max_psi_s = 1.0;
  limits.rig.segment_interval_min_s = 0.05;
  limits.stroke_mm = 2.0;
  limits.nominal_psi = 15.0;
  return limits;
}

bool any_named(const std::vector<CandidateExperiment>& items, std::string_view words) {
  return std::ranges::any_of(items, [&](const auto& item) { return item.name.find(words) != std::string::npos; });
}

TEST(CandidateExperiments, KeepTheLimitsShortestFirst) {
  CandidateLimits limits = rig();
  limits.longest_s = 400.0;
  const auto items = candidate_experiments(limits);
  ASSERT_GT(items.size(), 20u);
  EXPECT_TRUE(std::ranges::is_sorted(items, {}, &CandidateExperiment::duration_s));
  for (const CandidateExperiment& item : items) {
    EXPECT_LE(item.duration_s, limits.longest_s) << item.name;
    EXPECT_GT(item.duration_s, item.plan.nominal_s) << item.name << ": a turn takes time";
    const Series run = rehearse(item.plan, {.nominal_pressure_psi = 15.0}, {});
    for (const model::Instant& node : run.nodes) {
      ASSERT_LE(std::fabs(node.position_mm), limits.stroke_mm + 1e-6) << item.name;
      ASSERT_LE(std::fabs(node.velocity_mm_s), limits.rig.speed_max_mm_s + 1e-6) << item.name;
      ASSERT_LE(node.excess_pressure_psi, 15.0) << item.name;
    }
  }
}

/// A recording in which the crosshead stood: an experiment of 0 mm was the answer.
TEST(CandidateExperiments, MoveNoFurtherThanWasMoved) {
  CandidateLimits limits = rig();
  limits.stroke_mm = 0.0;
  EXPECT_TRUE(candidate_experiments(limits).empty());
  limits.pressure_matters = true;
  const auto items = candidate_experiments(limits);
  ASSERT_FALSE(items.empty());
  for (const CandidateExperiment& item : items) EXPECT_NE(item.name.find("pressure steps"), std::string::npos);
}

TEST(CandidateExperiments, FollowWhatTheRigCan) {
  CandidateLimits limits = rig();
  EXPECT_TRUE(any_named(candidate_experiments(limits), "at 10 mm/s"));
  EXPECT_FALSE(any_named(candidate_experiments(limits), "pressure"));
  limits.pressure_matters = true;
  EXPECT_TRUE(any_named(candidate_experiments(limits), "pressure steps of 1 psi"));
  limits.rig.speed_max_mm_s = 0.6;
  const auto slow = candidate_experiments(limits);
  EXPECT_FALSE(any_named(slow, "at 10 mm/s"));
  EXPECT_FALSE(any_named(slow, "at 2 mm/s"));
  EXPECT_TRUE(any_named(slow, "at 0.6 mm/s"));
}

TEST(CandidateExperiments, OneBeyondTheLimitsIsRefusedByTheCompiler) {
  EXPECT_NO_THROW((void)session_of("ramps", paper_ramps(2.0, 5.0, 0.01), rig()));
  EXPECT_THROW((void)session_of("too fast", paper_ramps(2.0, 50.0, 0.01), rig()), base::ConfigError);
  EXPECT_THROW((void)session_of("too far", paper_ramps(20.0, 5.0, 0.01), rig()), base::ConfigError);
}

TEST(Rehearsal, IsTheMotionThatThePlanAsksFor) {
  const CandidateExperiment item = session_of("ramps", paper_ramps(1.5, 2.0, 0.5), rig());
  const model::Reference reference{.elongation_at_zero_mm = 20.0, .nominal_pressure_psi = 15.0};
  const Sampling sampling{.full_s = 0.01, .averaged_s = 0.05};
  const Series run = rehearse(item.plan, reference, sampling);
  double high = -1e9, low = 1e9, fastest = 0.0, travelled = 0.0, readings = 0.0, waited = 0.0;
  for (std::size_t k = 0; k < run.nodes.size(); ++k) {
    const model::Instant& node = run.nodes[k];
    high = std::max(high, node.position_mm);
    low = std::min(low, node.position_mm);
    fastest = std::max(fastest, std::fabs(node.velocity_mm_s));
    travelled += std::fabs(node.step_mm);
    readings += run.count[k];
    EXPECT_DOUBLE_EQ(node.elongation_mm, node.position_mm + 20.0);
    EXPECT_NEAR(node.excess_pressure_psi, 0.0, 1e-9);
    EXPECT_GE(node.dt_s, 0.0);
    EXPECT_LE(node.dt_s, 2.1);
    if (std::fabs(node.velocity_mm_s) < 1e-9) waited += node.dt_s;
  }
  EXPECT_NEAR(high, 1.5, 1e-6);
  EXPECT_NEAR(low, -1.5, 1e-6);
  EXPECT_NEAR(fastest, 2.0, 1e-6);
  EXPECT_NEAR(travelled, 6.0, 1e-3) << "out and back, both ways";
  EXPECT_GT(waited, 4 * 30.0 * 0.95);
  // Between all rows at the averaged and all at the full rate.
  const double span_s = run.nodes.back().t_s - run.nodes.front().t_s;
  EXPECT_GT(readings, span_s / sampling.averaged_s);
  EXPECT_LT(readings, span_s / sampling.full_s);
  EXPECT_EQ(run.excitation.reference.recording_id, model::kPlannedRecordingId)
      << "no slip of another recording is in it";
}

TEST(Rehearsal, CornersAreRoundedAsTheFrameRoundsThem) {
  const CandidateExperiment item = session_of("ramps", paper_ramps(1.5, 2.0, 0.5), rig());
  const Series run = rehearse(item.plan, {}, {});
  // From 0 to 2 mm/s within 60 ms.
  double most = 0.0;
  for (const model::Instant& node : run.nodes) most = std::max(most, std::fabs(node.acceleration_mm_s2));
  EXPECT_NEAR(most, 2.0 / 0.06, 2.0);
}

}  // namespace
}  // namespace isorig::identify
