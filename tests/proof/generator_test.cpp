#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <set>

#include "base/text_file.hpp"
#include "proof/fit/nominal.hpp"
#include "proof/generator/case.hpp"
#include "proof/generator/unfinished.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;

RigParameters plain_rig() {
  RigParameters rig;
  rig.specimen = {90.0, 80.0, 2.0, {{1.5, 0.8}}};
  rig.air = {15.0, 0.0, 1.5, 0.0, 1000.0};
  return rig;
}

Motion one_ramp(double to_mm, double velocity_mm_s) {
  Motion motion;
  motion.rest(1.0);
  motion.dense(0.5, 6.0);
  motion.move_to(to_mm, velocity_mm_s);
  motion.rest(8.0);
  return motion;
}

class Scratch : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("isorig-proof-" + std::to_string(getpid()) +
                                           std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

TEST(ProofRig, RampAndHoldOfAStandardLinearSolidMatchTheClosedForm) {
  RigParameters rig = plain_rig();
  rig.crosshead = {1200.0, 1.0, 1e9};  // corners too sharp to matter
  constexpr double kVelocity_mm_s = 4.0, kStroke_mm = 2.0, kTau_s = 0.8;
  const Trace trace = simulate(rig, one_ramp(kStroke_mm, kVelocity_mm_s), {}, {}, 0.1e-3);
  const double end_s = kStroke_mm / kVelocity_mm_s;
  double worst_N = 0.0;
  for (std::size_t i = 0; i < trace.t_s.size(); ++i) {
    const double since_s = trace.t_s[i] - 1.0;
    if (since_s < 0.05 || std::abs(since_s - end_s) < 0.05) continue;
    const double stretch_mm = since_s < end_s ? kVelocity_mm_s * kTau_s * (1.0 - std::exp(-since_s / kTau_s))
                                              : kVelocity_mm_s * kTau_s * (1.0 - std::exp(-end_s / kTau_s)) *
                                                    std::exp(-(since_s - end_s) / kTau_s);
    const double position_mm = std::fmin(kVelocity_mm_s * since_s, kStroke_mm);
    worst_N = std::fmax(worst_N, std::abs(trace.force_N[i] - 2.0 * (position_mm + 10.0) - 1.5 * stretch_mm));
  }
  EXPECT_LT(worst_N, 2e-3);
}

TEST(ProofRig, HalvingTheStepMovesTheForceLessThanTheNoiseCanShow) {
  RigParameters rig = plain_rig();
  for (const char* name :
       {"coulomb_friction", "nonlinear_viscosity", "force_lag", "force_delay", "crosshead_backlash"}) {
    Random random(3, name);
    ConcealedEffect effect = draw_effect(effect_kind(name), random, rig, paper_motion({}));
    conceal(effect, rig);
  }
  const Trace coarse = simulate(rig, one_ramp(2.0, 10.0), {});
  const Trace fine = simulate(rig, one_ramp(2.0, 10.0), {}, {}, kStep_s / 4.0);
  double sum = 0.0;
  for (std::size_t i = 0; i < coarse.t_s.size(); ++i) sum += std::pow(coarse.force_N[i] - fine.force_N[i], 2);
  EXPECT_LT(std::sqrt(sum / static_cast<double>(coarse.t_s.size())), 0.01);
}

TEST(ProofRig, CrossheadLagsAndOvershootsWithinItsAcceleration) {
  RigParameters rig = plain_rig();
  rig.crosshead = {60.0, 0.6, 300.0};
  const Trace trace = simulate(rig, one_ramp(2.0, 10.0), {});
  const double furthest_mm = *std::ranges::max_element(trace.position_mm);
  EXPECT_GT(furthest_mm, 2.002);
  EXPECT_LT(furthest_mm, 2.2);
  for (std::size_t i = 2; i < trace.t_s.size(); ++i) {
    const double dt_s = trace.t_s[i] - trace.t_s[i - 1];
    if (dt_s > 0.01 || trace.t_s[i - 1] - trace.t_s[i - 2] > 0.01) continue;
    const double bend = trace.position_mm[i] - 2.0 * trace.position_mm[i - 1] + trace.position_mm[i - 2];
    EXPECT_LT(std::abs(bend) / (dt_s * dt_s), 301.0);
  }
}

TEST(ProofRig, FrictionWidensTheLoopByTwiceItsForceAndSlackNeverPushes) {
  RigParameters rig = plain_rig();
  rig.specimen.arms.clear();
  rig.hidden.friction_N = 0.7;
  Motion motion;
  motion.rest(1.0);
  motion.move_to(1.0, 0.1);
  motion.move_to(-1.0, 0.1);
  motion.move_to(1.0, 0.1);
  const Trace loop = simulate(rig, motion, {});
  double up_N = NAN, down_N = NAN;
  for (std::size_t i = 0; i < loop.t_s.size(); ++i) {
    const double elastic_N = 2.0 * (loop.position_mm[i] + 10.0);
    if (std::abs(loop.position_mm[i]) > 0.05) continue;
    if (loop.t_s[i] > 15.0 && loop.t_s[i] < 25.0) down_N = loop.force_N[i] - elastic_N;
    if (loop.t_s[i] > 35.0) up_N = loop.force_N[i] - elastic_N;
  }
  EXPECT_NEAR(up_N, 0.7, 1e-6);
  EXPECT_NEAR(down_N, -0.7, 1e-6);

  RigParameters soft = plain_rig();
  conceal({"slack", 0.8, 1.0, {}}, soft);
  const Trace paper = simulate(soft, paper_motion({}), {}, {}, 2e-3);
  EXPECT_EQ(*std::ranges::min_element(paper.force_N), 0.0);
}

TEST(ProofFit, RecoversTheNominalModelAndLeavesNothing) {
  const Trace trace = simulate(plain_rig(), paper_motion({}), {}, {}, 1e-3);
  const NominalFit fit = fit_nominal(trace.t_s, trace.position_mm, trace.force_N, 1);
  EXPECT_NEAR(fit.time_constants_s[0], 0.8, 0.01);
  EXPECT_NEAR(fit.coefficients[0], 2.0, 0.005);
  EXPECT_NEAR(fit.coefficients[1], 1.5, 0.01);
  EXPECT_LT(residual_size_N(fit, dense_rows(trace.t_s)), 0.01);
}

/// Correlation of neighbours among rows [from, from + count) of noise alone.
double of_neighbours(const std::vector<double>& noise, std::size_t from, std::size_t count) {
  double products = 0.0, squares = 0.0;
  for (std::size_t i = from; i + 1 < from + count; ++i) {
    products += noise[i] * noise[i + 1];
    squares += noise[i] * noise[i];
  }
  return products / squares;
}

TEST(ProofNoise, ForgetsByTimeOrByReadings) {
  constexpr std::size_t kRows = 40'000;
  Trace trace;
  for (std::size_t i = 0; i < 2 * kRows; ++i) {
    trace.t_s.push_back(i == 0 ? 0.0 : trace.t_s.back() + (i < kRows ? 0.01 : 0.2));
    trace.position_mm.push_back(0.0);
    trace.force_N.push_back(0.0);
  }
  messages::RecordingMetadata metadata;
  metadata.rest_length_mm = 90.0;
  metadata.pressurized_rest_length_mm = 80.0;
  const auto correlations = [&](double readings) {
    Instruments in;
    in.force_noise_N = 0.0;
    in.force_step_N = 1e-9;
    in.coloured_noise_N = 0.02;
    in.coloured_time_s = 0.4;
    in.coloured_readings = readings;
    in.pressure_recorded = false;
    Random random(5, "noise");
    const std::vector<double> noise_N = measure(trace, in, trace.t_s.back(), metadata, random).recording.frame.force_N;
    double squares = 0.0;
    for (const double n : noise_N) squares += n * n;
    // The relative variance of a mean square is 2 (1 + rho^2) / (1 - rho^2) / n: at rho = 0.975 in half of the rows it
    // leaves the root of both halves a deviation of 1.1 %. Five of these.
    EXPECT_NEAR(std::sqrt(squares / static_cast<double>(noise_N.size())), 0.02, 0.02 * 0.056);
    return std::array{of_neighbours(noise_N, 0, kRows), of_neighbours(noise_N, kRows, kRows)};
  };
  // The deviation of a correlation rho between neighbours is sqrt((1 - rho^2) / n): 0.004 at most. Four of these.
  const auto [fast, slow] = correlations(0.0);
  EXPECT_NEAR(fast, std::exp(-0.01 / 0.4), 0.0045);
  EXPECT_NEAR(slow, std::exp(-0.2 / 0.4), 0.016);
  const auto [fast_too, slow_too] = correlations(12.0);
  EXPECT_NEAR(fast_too, std::exp(-1.0 / 12.0), 0.008);
  EXPECT_NEAR(slow_too, std::exp(-1.0 / 12.0), 0.008);
}

TEST(ProofPlan, HoldsEveryKindAndEveryEffect) {
  const std::vector<CasePlan> plans = plan_study(1, 96);
  std::set<Category> categories;
  std::set<std::string> singles;
  for (const CasePlan& plan : plans) {
    categories.insert(plan.category);
    if (plan.category == Category::kSingle) singles.insert(plan.effects.front());
    if (plan.category == Category::kPair) {
      EXPECT_NE(plan.effects[0], plan.effects[1]);
    }
    EXPECT_EQ(plan.effects.empty(), plan.category == Category::kNull);
  }
  EXPECT_EQ(categories.size(), 6U);
  EXPECT_EQ(singles.size(), named_effects().size());
}

TEST_F(Scratch, EqualSeedsGiveEqualStudiesWhateverTheThreads) {
  const StudyOptions one{11, 2, folder_ / "a", 1};
  StudyOptions two = one;
  two.out = folder_ / "b";
  two.threads = 2;
  EXPECT_EQ(generate_study(one), generate_study(two));
  for (const char* file : {"case-000/train/frame.csv", "case-001/heldout/pressure.csv", "sealed/truth/case-001.csv"})
    EXPECT_EQ(sha256(base::read_text_file(one.out / file)), sha256(base::read_text_file(two.out / file))) << file;
}

/// What is kept of an unfinished study is of that study alone.
TEST_F(Scratch, AnUnfinishedStudyIsGoneOnWithUnlessItIsAnother) {
  const StudyOptions study{11, 2, folder_, 1};
  const nlohmann::ordered_json label{{"case", "case-001"}, {"noise_N", 0.1}};
  EXPECT_EQ(unfinished_seed(study), std::nullopt);
  Unfinished(study).keep(1, label);
  EXPECT_EQ(Unfinished(study).kept(1), label);
  EXPECT_EQ(Unfinished(study).kept(0), std::nullopt);
  StudyOptions unseeded = study;
  unseeded.seed = 0;
  EXPECT_EQ(unfinished_seed(unseeded), 11U);
  write_text(folder_ / "sealed/unfinished/0.json", "{\"case\": \"ca");
  EXPECT_EQ(Unfinished(study).kept(0), std::nullopt) << "half a label";
  for (const auto& change : {+[](StudyOptions& o) { o.seed = 12; }, +[](StudyOptions& o) { o.cases = 3; },
                             +[](StudyOptions& o) { o.laws = Laws::kForeign; }}) {
    Unfinished(study).keep(1, label);
    StudyOptions other = study;
    change(other);
    if (other.seed == study.seed) {
      EXPECT_EQ(unfinished_seed(other), std::nullopt);
    }
    EXPECT_EQ(Unfinished(other).kept(1), std::nullopt);
  }
  Unfinished(study).finish();
  EXPECT_FALSE(fs::exists(folder_ / "sealed/unfinished"));
}

TEST_F(Scratch, SealBreaksWhenLabelsChange) {
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  seal(folder_ / "labels.json", folder_ / "labels.sha256", "{\"effect\": \"slack\"}");
  EXPECT_EQ(unseal(folder_ / "labels.json", folder_ / "labels.sha256"), "{\"effect\": \"slack\"}");
  write_text(folder_ / "labels.json", "{\"effect\": \"slick\"}");
  EXPECT_THROW((void)unseal(folder_ / "labels.json", folder_ / "labels.sha256"), std::runtime_error);
}

}  // namespace
}  // namespace isorig::proof
