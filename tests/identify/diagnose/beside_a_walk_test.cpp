// A zero that walks at random is named, and what else is missing is found and measured beside it.
#include "identify/diagnose/search/beside_a_walk.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "model/elements.hpp"
#include "model/number_sheet.hpp"

namespace isorig::identify {
namespace {

/// With steps of the zero from reading to reading, of the variance `rate_N2_s` times the time between.
messages::Recording walked(messages::Recording recording, double rate_N2_s, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  auto& frame = recording.frame;
  double zero_N = 0.0;
  for (std::size_t k = 1; k < frame.size(); ++k) {
    zero_N += std::sqrt(rate_N2_s * (frame.t_s[k] - frame.t_s[k - 1])) * normal(random);
    frame.force_N[k] += zero_N;
  }
  return recording;
}

Diagnosis diagnose_walked(const test::ConcealedSpecimen& bench, double rate_N2_s, unsigned seed) {
  return diagnose({walked(test::record(bench), rate_N2_s, seed)}, {"bench"}, model::nominal_model("slse1"), {})
      .diagnosis;
}

std::string names(const Diagnosis& d) {
  std::string out;
  for (const MissingEffect& missing : d.missing) out += std::string(missing.effect->name) + " ";
  return out;
}

bool is_named(const Diagnosis& d, std::string_view name) {
  return std::ranges::any_of(d.missing, [&](const auto& m) { return m.effect->name == name && m.probability > 0.9; });
}

constexpr double kRate_N2_s = 1e-4;  // 0.36 N rms over the 1270 s of the bench, whose spring alone spans 20 N

/// Not the drift alone: its rate, and the specimen's own numbers, which the walk must not pull along.
TEST(BesideAWalk, AWalkAloneIsNamedAndThePartsAreRight) {
  const Diagnosis d = diagnose_walked({.seed = 5}, kRate_N2_s, 21);
  EXPECT_EQ(names(d), "zero_drift ");
  EXPECT_TRUE(is_named(d, "zero_drift"));
  ASSERT_TRUE(d.walk);
  // 635 blocks: 5.6 % of the rate, three of that.
  EXPECT_NEAR(d.walk->rate_N2_s, kRate_N2_s, 0.17 * kRate_N2_s);
  // 0.36 N over a stroke of 4 mm would be 0.09 N/mm, had the stiffness followed the walk.
  const NamedValue& stiffness = d.model_numbers[0][0];
  EXPECT_LT(stiffness.low, 2.5);
  EXPECT_GT(stiffness.high, 2.5);
  EXPECT_LT(stiffness.high - stiffness.low, 0.09);
  EXPECT_TRUE(std::ranges::any_of(
      d.notes, [](const std::string& note) { return note.find("walks at random") != std::string::npos; }));
  EXPECT_EQ(diagnosis_json(d)["zero_walk"]["rms_N_per_sqrt_s"], d.walk->rms_N(1.0));
}

TEST(BesideAWalk, AnotherEffectIsFoundBesideIt) {
  const Diagnosis d = diagnose_walked({.quadratic_N_mm2 = 0.06, .seed = 6}, kRate_N2_s, 22);
  EXPECT_TRUE(is_named(d, "zero_drift")) << names(d);
  EXPECT_TRUE(is_named(d, "strain_stiffening")) << names(d);
  EXPECT_EQ(d.missing.size(), 2U) << names(d);
}

TEST(BesideAWalk, ADriftByALawKeepsItsLaw) {
  const Diagnosis d =
      diagnose({test::record({.drift_N_h = 3.0, .seed = 7})}, {"bench"}, model::nominal_model("slse1"), {}).diagnosis;
  EXPECT_FALSE(d.walk);
  ASSERT_EQ(names(d), "zero_drift ");
  EXPECT_EQ(d.missing.front().law, "linear");
}

/// Least squares leave nothing that a constant could take away, and touch no other number.
TEST(BesideAWalk, TheLevelIsThatOfTheForceAndAllElseIsKept) {
  const std::vector<Series> series{prepare_series("bench", walked(test::record({.seed = 5}), kRate_N2_s, 21), {})};
  const double lasts_s = series.front().nodes.back().t_s - series.front().nodes.front().t_s;
  const Search search(series, {0.02, std::sqrt(5.0 * kRate_N2_s * lasts_s), 10.0 * lasts_s}, 1);
  model::ModelSpec off = search.nominal(model::nominal_model("slse1")).fit.spec;
  const auto constant = std::ranges::find(off.parts, &model::element::constant(), &model::Part::physics);
  ASSERT_NE(constant, off.parts.end());
  constant->coefficients[0] += 1.0;
  const model::ModelSpec level = levelled(search, off);
  const Problem& problem = search.instrument_problem();
  const Eigen::VectorXd left_N = problem.target() - problem.predict(level);
  double sum_N = 0.0, readings = 0.0;
  for (std::size_t k = 0; k < series.front().count.size(); ++k) {
    sum_N += series.front().count[k] * left_N[static_cast<Eigen::Index>(k)];
    readings += series.front().count[k];
  }
  EXPECT_NEAR(sum_N / readings, 0.0, 1e-9);
  for (std::size_t i = 0; i < off.parts.size(); ++i) {
    EXPECT_EQ(level.parts[i].parameters, off.parts[i].parameters);
    EXPECT_EQ(level.parts[i].fixed, off.parts[i].fixed);
    if (off.parts[i].physics != &model::element::constant()) {
      EXPECT_EQ(level.parts[i].coefficients, off.parts[i].coefficients);
    }
  }
}

/// The drift is withheld: nothing is to be found in its place by another way.
TEST(BesideAWalk, IsNotLookedForWhereTheDriftIsWithheld) {
  const auto recording = walked(test::record({.seed = 5}), kRate_N2_s, 21);
  const Diagnosis named = diagnose_walked({.seed = 5}, kRate_N2_s, 21);
  ASSERT_EQ(named.missing.size(), 1U);
  DiagnosisOptions options;
  options.withheld = {named.missing.front().effect};
  const Diagnosis d = diagnose({recording}, {"bench"}, model::nominal_model("slse1"), options).diagnosis;
  EXPECT_FALSE(d.walk);
}

}  // namespace
}  // namespace isorig::identify
