// What a rig's own recording begins and ends with is not the specimen's test.
#include "identify/diagnose/guard/start_up_cut.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {
namespace {

/// 100 s at 10 Hz: nothing for 5 s, up to `nominal_psi` within 10 s, held, let go at 90 s when `vented`.
messages::Recording session(double nominal_psi, bool filled, bool vented) {
  messages::Recording out;
  out.metadata.rest_length_mm = 100.0;
  out.metadata.nominal_pressure_psi = nominal_psi;
  out.pressure.emplace();
  for (int i = 0; i <= 1000; ++i) {
    const double t_s = 0.1 * i;
    double share = filled ? 1.0 : std::fmin(std::fmax((t_s - 5.0) / 10.0, 0.0), 1.0);
    if (vented && t_s > 90.0) share = std::exp(-(t_s - 90.0));
    out.frame.t_s.push_back(t_s);
    out.frame.position_mm.push_back(std::sin(t_s));
    out.frame.force_N.push_back(2.0 * share);
    out.pressure->t_s.push_back(t_s + 0.03);
    out.pressure->pressure_psi.push_back(nominal_psi * share + 0.02 * std::sin(7.0 * t_s));
  }
  return out;
}

TEST(Filling, IsCutAtBothEnds) {
  auto recording = session(15.0, false, true);
  const auto cut = cut_start_up(recording);
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->kind, "filling");
  EXPECT_EQ(recording.frame.size() + cut->rows, 1001U);
  // 95 % of the pressure is there at 14.5 s and has stayed for a second at 15.5 s.
  EXPECT_NEAR(recording.frame.t_s.front(), 15.5, 0.3);
  EXPECT_LT(recording.frame.t_s.back(), 90.0);
  EXPECT_GT(recording.frame.t_s.back(), 88.0);
  EXPECT_EQ(recording.frame.position_mm.size(), recording.frame.size());
  EXPECT_EQ(recording.frame.force_N.size(), recording.frame.size());
  EXPECT_NEAR(recording.frame.position_mm.front(), std::sin(recording.frame.t_s.front()), 1e-12);
  EXPECT_GE(recording.pressure->t_s.front(), recording.frame.t_s.front() - 0.1);
  EXPECT_LE(recording.pressure->t_s.back(), recording.frame.t_s.back() + 0.1);
  EXPECT_EQ(recording.pressure->size(), recording.pressure->pressure_psi.size());
}

TEST(Filling, NothingIsCutUnderPressureOrWithoutAny) {
  auto filled = session(15.0, true, false);
  EXPECT_FALSE(cut_start_up(filled));
  EXPECT_EQ(filled.frame.size(), 1001U);
  auto dry = session(15.0, false, true);
  dry.pressure.reset();
  EXPECT_FALSE(cut_start_up(dry));
  auto nameless = session(15.0, false, true);
  nameless.metadata.nominal_pressure_psi.reset();
  EXPECT_FALSE(cut_start_up(nameless));
  // It never gets there: a leak or a wrong number in recording.toml, to be seen and not cut away.
  auto never = session(15.0, false, false);
  never.metadata.nominal_pressure_psi = 30.0;
  EXPECT_FALSE(cut_start_up(never));
  EXPECT_EQ(never.frame.size(), 1001U);
}

/// A standard linear solid under a session's own filling: at 20 Hz, filled within 5 s and stretched by that,
/// then 20 s of rest and ramps of three velocities. The arm is solved exactly for straight motion.
messages::Recording clean_session(double nominal_psi, unsigned seed) {
  constexpr double kDt_s = 0.05, kTau_s = 6.0, kSpring_N_mm = 1.2, kArm_N_mm = 0.9, kStretch_mm = 5.0;
  std::mt19937 random(seed);
  std::normal_distribution<double> noise;
  messages::Recording out;
  out.metadata.rest_length_mm = 95.0;
  out.metadata.pressurized_rest_length_mm = 95.0 - kStretch_mm;
  out.metadata.nominal_pressure_psi = nominal_psi;
  out.pressure.emplace();
  double target_mm = 0.0, position_mm = 0.0, velocity_mm_s = 0.0, last_mm = 0.0, arm_mm = 0.0;
  for (int i = 0; i <= 6000; ++i) {
    const double t_s = kDt_s * i;
    const double share = std::fmin(t_s / 5.0, 1.0);
    if (t_s > 25.0 && i % 400 == 0) {
      const int ramp = i / 400;
      target_mm = ramp % 2 == 0 ? 0.0 : 3.0;
      velocity_mm_s = std::array{0.5, 2.0, 8.0}[static_cast<std::size_t>(ramp / 2 % 3)];
    }
    const double way_mm = target_mm - position_mm;
    position_mm += std::copysign(std::fmin(std::fabs(way_mm), velocity_mm_s * kDt_s), way_mm);
    const double elongation_mm = position_mm + kStretch_mm * share;
    const double rate_mm_s = i == 0 ? 0.0 : (elongation_mm - last_mm) / kDt_s;
    const double kept = std::exp(-kDt_s / kTau_s);
    if (i > 0) arm_mm = kept * arm_mm + rate_mm_s * kTau_s * (1.0 - kept);
    last_mm = elongation_mm;
    out.frame.t_s.push_back(t_s);
    out.frame.position_mm.push_back(position_mm + 5e-4 * noise(random));
    out.frame.force_N.push_back(kSpring_N_mm * elongation_mm + kArm_N_mm * arm_mm + 0.01 * noise(random));
    out.pressure->t_s.push_back(t_s);
    out.pressure->pressure_psi.push_back(nominal_psi * share + 0.005 * noise(random));
  }
  return out;
}

// What the filling left in the arm at the cut is no physics that the model lacks.
TEST(Filling, LeavesForceInTheArmsAndThatIsNoEffect) {
  const auto nominal = model::nominal_model("slse1");
  const Study study = diagnose({clean_session(10.0, 11)}, {"session"}, nominal, {});
  const Diagnosis& d = study.diagnosis;
  EXPECT_EQ(d.verdict, Verdict::kConsistent) << diagnosis_json(d)["missing"].dump(1);
  ASSERT_TRUE(d.nominal.has("arm_start"));
  for (const auto& part : d.nominal.parts) {
    if (part.physics->name == "maxwell") {
      EXPECT_NEAR(part.parameters[0], 6.0, 0.1);
    }
    // 5 mm within 5 s into an arm of 0.9 N/mm, and a second of relaxing until the rows begin.
    if (part.physics->name == "arm_start") {
      EXPECT_NEAR(part.parameters[0], 6.0, 0.1);
      EXPECT_NEAR(part.coefficients[0], 0.9 * 6.0 * (1.0 - std::exp(-5.0 / 6.0)) * std::exp(-1.0 / 6.0), 0.2);
    }
  }
  EXPECT_TRUE(d.warnings.empty());
  // It is this recording's: the model predicts another one from rest.
  const std::string text = model::model_text(d.model);
  const auto again = model::parse_model(text, "again");
  model::RunningModel running(again, {.elongation_at_zero_mm = 5.0, .recording_id = 100.0});
  const model::Instant first{.t_s = 0.0, .elongation_mm = 5.0};
  running.reset(first);
  EXPECT_NEAR(running.step(first), 6.0, 0.1);
}

}  // namespace
}  // namespace isorig::identify
