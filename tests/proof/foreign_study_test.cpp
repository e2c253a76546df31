#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "base/text_file.hpp"
#include "proof/fit/nominal.hpp"
#include "proof/foreign_laws/case.hpp"
#include "proof/generator/effects.hpp"
#include "proof/generator/study.hpp"
#include "proof/scoring/outcome.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof::foreign {
namespace {

namespace fs = std::filesystem;

TEST(ForeignKinds, EveryNamedEffectHasTwoLawsAndEveryLawASourceWithItsYear) {
  std::map<std::string_view, int> laws;
  std::set<std::string_view> names;
  for (const Kind& kind : kinds()) {
    ++laws[kind.effect];
    EXPECT_TRUE(names.insert(kind.law).second) << kind.law;
    EXPECT_THAT(std::string(kind.source), testing::ContainsRegex("[12][0-9][0-9][0-9]")) << kind.law;
    EXPECT_FALSE(kind.depends_on.empty()) << kind.law;
  }
  for (const EffectKind& named : named_effects()) EXPECT_GE(laws[named.name], 2) << named.name;
  EXPECT_GE(laws[kUnknown], 8);
  EXPECT_EQ(laws.size(), named_effects().size() + 1);
}

Rig plain_rig() {
  Rig rig;
  rig.arms = {{1.5, 0.8, {}}};
  rig.peak_N = 28.0;
  rig.supply = {Air::kHunting, 15.0, 0.5, 9.0};
  return rig;
}

Path short_path() {
  Path path(200.0);
  path.rest(3.0);
  path.triangle(4.0, 2.0, 1);
  path.rest(2.0);
  path.ramp(2.0, 8.0);
  path.rest(3.0);
  path.sine(1.5, 0.8, 4);
  path.rest(2.0);
  return path;
}

TEST(ForeignRig, NominalRigIsTheNominalModel) {
  const Path path = short_path();
  const Trace trace = read(play(plain_rig(), path), path, {.fast_Hz = 1000.0, .slow_Hz = 10.0});
  const NominalFit fit = fit_nominal(trace.t_s, trace.position_mm, trace.force_N, 1);
  EXPECT_NEAR(fit.time_constants_s[0], 0.8, 0.01);
  EXPECT_NEAR(fit.coefficients[0], 2.0, 0.005);
  EXPECT_NEAR(fit.coefficients[1], 1.5, 0.01);
  EXPECT_LT(residual_size_N(fit, dense_rows(trace.t_s)), 0.01);
}

/// Each law, as strong as its search begins, moves the force of a session, leaves it finite, and acts in proportion
/// to the rig: the same shape in a rig ten times as strong moves ten times the force.
TEST(ForeignKinds, EveryLawMovesTheForceInProportionToTheRig) {
  const Path path = short_path();
  for (const Kind& kind : kinds()) {
    const auto moved = [&](double scale) {
      Rig rig = plain_rig();
      rig.stiffness_N_mm *= scale;
      rig.arms[0].stiffness_N_mm *= scale;
      rig.peak_N *= scale;
      const Signal before = play(rig, path).force_N;
      Random random(5, kind.law);
      kind.conceal(kind.start, kind.draw(random, rig, path), rig);
      Signal after = play(rig, path).force_N;
      for (std::size_t i = 0; i < after.size(); ++i) after[i] -= before[i];
      return after;
    };
    const Signal one = moved(1.0), ten = moved(10.0);
    double largest_N = 0.0, apart_N = 0.0;
    for (std::size_t i = 0; i < one.size(); ++i) {
      ASSERT_TRUE(std::isfinite(one[i])) << kind.law;
      largest_N = std::fmax(largest_N, std::abs(one[i]));
      apart_N = std::fmax(apart_N, std::abs(ten[i] / 10.0 - one[i]));
    }
    EXPECT_GT(largest_N, 0.02) << kind.law;
    EXPECT_LT(apart_N, 1e-3 + 1e-3 * largest_N) << kind.law;
  }
}

TEST(ForeignPlan, AFullSetHoldsWhatItPromises) {
  const std::vector<CasePlan> plans = plan_study(1, 600);
  std::map<Category, int> categories;
  std::set<std::string> laws;
  std::set<Trap> traps;
  for (const CasePlan& plan : plans) {
    ++categories[plan.category];
    if (plan.category == Category::kNull) traps.insert(plan.trap);
    EXPECT_EQ(plan.effects.empty(), plan.category == Category::kNull);
    std::set<std::string_view> effects;
    for (const std::string& law : plan.effects) {
      laws.insert(law);
      effects.insert(kind_of_law(law).effect);
    }
    EXPECT_EQ(effects.size(), plan.effects.size());
    EXPECT_TRUE(plan.size == 1.0 || plan.size == 0.5 || plan.size == 0.25);
    EXPECT_EQ(plan.category == Category::kOutOfCatalogue, effects.contains(kUnknown));
  }
  EXPECT_GE(categories[Category::kNull], 150);
  EXPECT_GE(categories[Category::kTriple], 25);
  EXPECT_EQ(laws.size(), kinds().size());
  EXPECT_EQ(traps.size(), 11U);
}

TEST(ForeignCase, SizesAreTheResidualsThatWereAsked) {
  for (const auto& [law, size] : {std::pair{"bouc_wen", 0.5}, std::pair{"hyperbolic_knee", 0.25}}) {
    const Case c = draw_case(3, 0, {Category::kSingle, Trap::kNone, {law}, size});
    // Full size is 10 to 40 noises and is met within 10 %.
    EXPECT_GT(c.residual_over_noise, 10.0 * size * 0.9) << law;
    EXPECT_LT(c.residual_over_noise, 40.0 * size * 1.1) << law;
    EXPECT_NEAR(c.concealed[0].residual_over_noise, c.residual_over_noise, 1e-9);
  }
  const Case faint = draw_case(3, 1, {Category::kBackground, Trap::kNone, {"bouc_wen"}, 1.0});
  EXPECT_NEAR(faint.background_over_noise / faint.concealed[0].residual_over_noise, 1.0 / 8.0, 0.03);
  // Drawn with a time of 10.6 ms, it was a play of two millionths of the stroke: a lag under another name.
  const Case play = draw_case(20261150, 23, {Category::kSingle, Trap::kNone, {"compliant_play"}, 0.25});
  EXPECT_GT(play.concealed[0].strength, 1e-3);
  EXPECT_LT(play.residual_over_noise, 40.0 * 0.25 * 1.1);
  Rig lag_alone = play.clean;
  kind_of_law("compliant_play").conceal(1e-9, play.concealed[0].shape, lag_alone);
  const auto moved_N = [&](const Rig& rig) {
    const Signal with = isorig::proof::foreign::play(rig, play.train).force_N;
    const Signal without = isorig::proof::foreign::play(play.clean, play.train).force_N;
    double squares_N2 = 0.0;
    for (std::size_t i = 0; i < with.size(); ++i) squares_N2 += (with[i] - without[i]) * (with[i] - without[i]);
    return std::sqrt(squares_N2);
  };
  EXPECT_LT(moved_N(lag_alone), 0.5 * moved_N(play.train_rig));
  const Case slip = draw_case(3, 2, {Category::kSingle, Trap::kNone, {"stick_slips"}, 1.0});
  EXPECT_EQ(slip.train_rig.kinematics.size(), 1U);
  EXPECT_TRUE(slip.heldout_rig.kinematics.empty());
}

class ForeignStudy : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("isorig-foreign-" + std::to_string(getpid()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

TEST_F(ForeignStudy, IsDeterminedByItsSeedAndTellsNothingBeforeItsSealIsBroken) {
  StudyOptions one{12, 3, folder_ / "a", 1, Laws::kForeign};
  StudyOptions two = one;
  two.out = folder_ / "b";
  two.threads = 3;
  EXPECT_EQ(generate_study(one), generate_study(two));
  for (const auto& entry : fs::recursive_directory_iterator(one.out)) {
    if (!entry.is_regular_file()) continue;
    const std::string text = base::read_text_file(entry.path());
    EXPECT_EQ(text, base::read_text_file(two.out / fs::relative(entry.path(), one.out))) << entry.path();
    if (fs::relative(entry.path(), one.out).begin()->string() == "sealed") continue;
    for (const Kind& kind : kinds())
      EXPECT_EQ(text.find(kind.law), std::string::npos) << entry.path() << " tells of " << kind.law;
    for (const EffectKind& named : named_effects())
      EXPECT_EQ(text.find(named.name), std::string::npos) << entry.path() << " tells of " << named.name;
    EXPECT_EQ(text.find("foreign"), std::string::npos) << entry.path();
  }
  const std::string labels = unseal(one.out / "sealed" / "labels.json", one.out / "labels.sha256");
  EXPECT_EQ(laws_of_labels(labels), "foreign");
  const std::vector<Label> read = parse_labels(labels);
  ASSERT_EQ(read.size(), 3U);
  for (const Label& label : read) EXPECT_EQ(label.laws.size(), label.effects.size());
}

}  // namespace
}  // namespace isorig::proof::foreign
