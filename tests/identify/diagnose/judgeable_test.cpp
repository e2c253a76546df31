#include "identify/diagnose/judgeable.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {
namespace {

/// A force of 1 N rms.
Study study_of(NoiseSource source, double noise_N, double noise_scale) {
  Study study;
  study.series.emplace_back();
  for (int k = 0; k < 1000; ++k)
    study.series[0].recording.frame.force_N.push_back(7.0 + std::sqrt(2.0) * std::sin(0.02 * M_PI * k));
  study.usable.emplace_back();
  study.noise.source = source;
  study.diagnosis.noise_N = noise_N;
  study.diagnosis.noise_scale = noise_scale;
  return study;
}

TEST(Judgeable, AModelThatExplainsTheForceToItsMeasuredNoise) {
  EXPECT_FALSE(unjudged(study_of(NoiseSource::kRests, 0.02, 1.0), 0.02).has_value());
  EXPECT_FALSE(unjudged(study_of(NoiseSource::kRepetitions, 0.02, 1.5), 0.025).has_value());
  // A guess that the residual agrees with is as good as a measurement of white noise.
  EXPECT_FALSE(unjudged(study_of(NoiseSource::kDifferences, 0.02, 1.1), 0.021).has_value());
}

TEST(Judgeable, NotWhereTheForceHardlyExceedsItsNoise) {
  const auto found = unjudged(study_of(NoiseSource::kRests, 0.4, 1.0), 0.4);
  ASSERT_TRUE(found.has_value());
  EXPECT_NE(found->why.find("excitation"), std::string::npos) << found->why;
}

TEST(Judgeable, NotWhereTheModelExplainsTooLittleOfTheForce) {
  // A quarter of the variance is left.
  const auto found = unjudged(study_of(NoiseSource::kDifferences, 0.02, 1.0), 0.5);
  ASSERT_TRUE(found.has_value());
  EXPECT_NE(found->why.find("25 %"), std::string::npos) << found->why;
  EXPECT_FALSE(unjudged(study_of(NoiseSource::kRests, 0.02, 1.0), 0.3).has_value()) << "9 % of the variance";
}

TEST(Judgeable, NotWhereWhatWasLeftOutIsPredictedFarWorse) {
  Study study = study_of(NoiseSource::kRests, 0.02, 1.0);
  study.diagnosis.nominal_errors.heldout_rmse_N = 0.05;
  EXPECT_FALSE(unjudged(study, 0.02).has_value());
  study.diagnosis.nominal_errors.heldout_rmse_N = 0.07;
  const auto found = unjudged(study, 0.02);
  ASSERT_TRUE(found.has_value());
  EXPECT_NE(found->why.find("left out of the fit with 0.07 N"), std::string::npos) << found->why;
}

TEST(Judgeable, AForceThatStandsStillVariesByNothingHoweverLargeItIs) {
  Study study = study_of(NoiseSource::kRests, 1e-9, 1.0);
  study.series[0].recording.frame.force_N.assign(1000, 100.1);
  const auto found = unjudged(study, 0.0);
  ASSERT_TRUE(found.has_value());
  EXPECT_NE(found->why.find("varies by 0 N"), std::string::npos) << found->why;
}

TEST(Judgeable, NotByAGuessedNoiseThatTheResidualExceeds) {
  const auto found = unjudged(study_of(NoiseSource::kDifferences, 0.02, 9.0), 0.06);
  ASSERT_TRUE(found.has_value());
  EXPECT_NE(found->record.find("at rest"), std::string::npos) << found->record;
  EXPECT_FALSE(unjudged(study_of(NoiseSource::kRests, 0.02, 9.0), 0.06).has_value());
}

TEST(Judgeable, TheVerdictStandsInTheDiagnosisWithWhatToRecord) {
  // A specimen of 4 mN/mm moved by 2 mm, read with 20 mN of noise.
  const test::ConcealedSpecimen soft{
      .stiffness_N_mm = 0.002, .arm_N_mm = 0.002, .elongation_at_zero_mm = 0.0, .seed = 8};
  const Diagnosis d = diagnose({test::record(soft)}, {"soft"}, model::nominal_model("slse1"), {}).diagnosis;
  EXPECT_EQ(d.verdict, Verdict::kCannotJudge);
  const auto json = diagnosis_json(d);
  EXPECT_EQ(json.at("verdict"), "cannot_judge");
  EXPECT_FALSE(json.at("cannot_judge").at("record").get<std::string>().empty());
  EXPECT_TRUE(json.at("missing").empty());
}

/// The rests know a white noise of 20 mN by 2 %, and 1 % more is chance.
TEST(Judgeable, WhatTheRestsAllowIsSaidAsWhatItIs) {
  const auto left_with = [](const NoiseModel& noise, NoiseSource source) {
    Study study = study_of(source, 0.02, 1.0);
    study.series = {
        prepare_series("bench", test::record({.force_noise_N = 0.02, .force_step_N = 1e-4, .seed = 11}), {})};
    return noise_beyond_the_rests(study, noise);
  };
  const auto white = left_with({.white_N = 0.0202}, NoiseSource::kRests);
  ASSERT_TRUE(white.has_value());
  EXPECT_NE(white->why.find("a white noise of 0.0202 N, and the 2250 readings"), std::string::npos) << white->why;
  const NoiseModel mixed{.white_N = 0.02, .coloured_N = 0.003, .correlation_s = 0.5};
  const auto coloured = left_with(mixed, NoiseSource::kRests);
  ASSERT_TRUE(coloured.has_value());
  EXPECT_NE(coloured->why.find("a noise of 0.003 N that is correlated over 0.5 s"), std::string::npos) << coloured->why;
  EXPECT_FALSE(left_with({.white_N = 0.023}, NoiseSource::kRests).has_value());
  EXPECT_FALSE(left_with(mixed, NoiseSource::kRepetitions).has_value()) << "no rests, nothing to hold it against";
}

/// An estimate that stands far along the ridge: the same steps, and a noise that no rest allows. The recording lasts
/// some 100 times the 10 s in which a noise of 5 s is independent: its correlation is known to 1.5 times, three
/// standard deviations, its amplitude to the root of that.
TEST(Judgeable, WhatIsLeftIsTheLikeliestNoise) {
  Study study;
  study.series = {prepare_series("bench", test::record({.coloured_N = 0.03, .coloured_s = 5.0, .seed = 7}), {})};
  const Search search(study.series, {0.02, 0.0, 1.0}, 2);
  study.selection.pool.push_back(search.nominal(model::nominal_model("slse1")));
  study.selection.pool[0].fit.noise = {0.02, 0.03 * std::sqrt(20.0), 100.0};
  const NoiseModel left = likeliest_noise(study);
  EXPECT_NEAR(std::log(left.correlation_s / 5.0), 0.0, std::log(1.5));
  EXPECT_NEAR(std::log(left.coloured_N / 0.03), 0.0, 0.5 * std::log(1.5));
}

/// Coloured noise beside white noise of 20 mN. The strokes are read a thousand times a second, so that a bin of theirs
/// shows 15 mN of the one beside 3 mN of the other; rests that are read every 0.6 s do not.
TEST(Judgeable, NotWhereWhatIsLeftMayBeNoiseThatTheRestsDoNotShow) {
  const messages::Recording coloured =
      test::record({.coloured_N = 0.015, .coloured_s = 3.0, .fast_interval_s = 0.001, .seed = 2});
  const auto diagnosed = [](const messages::Recording& recording) {
    return diagnose({recording}, {"bench"}, model::nominal_model("slse1"), {}).diagnosis;
  };
  const Diagnosis seldom = diagnosed(test::seldom_read_at_rest(coloured, 0.5));
  EXPECT_EQ(seldom.verdict, Verdict::kCannotJudge);
  ASSERT_TRUE(seldom.unjudged.has_value());
  EXPECT_NE(seldom.unjudged->why.find("readings of the rests"), std::string::npos) << seldom.unjudged->why;
  EXPECT_NE(seldom.unjudged->record.find("rests"), std::string::npos) << seldom.unjudged->record;
  EXPECT_TRUE(seldom.missing.empty());

  EXPECT_EQ(diagnosed(coloured).verdict, Verdict::kConsistent) << "rests read five times a second show the noise";

  // Friction that grows with the square of the position is in no catalogue, and its residual lasts longer than rests
  // do.
  const Diagnosis unknown = diagnosed(test::record({.friction_N_mm2 = 0.02, .fast_interval_s = 0.001}));
  EXPECT_EQ(unknown.verdict, Verdict::kUnknownPhysics);
}

// One ramp of a clean specimen, or one with much friction: whatever fits so few rows well is no finding.
TEST(Judgeable, FewRowsNameNothing) {
  int unjudged_ones = 0;
  for (const double friction_N : {0.0, 2.0}) {
    const messages::Recording whole = test::record({.friction_N = friction_N});
    const auto& x = whole.frame.position_mm;
    std::size_t first = 0;
    while (std::fabs(x[first] - x[0]) < 0.1) ++first;
    for (const std::ptrdiff_t rows : {20, 30, 60, 99}) {
      messages::Recording window = whole;
      for (auto* column : {&window.frame.t_s, &window.frame.position_mm, &window.frame.force_N}) {
        column->erase(column->begin(), column->begin() + static_cast<std::ptrdiff_t>(first) - 10);
        column->resize(static_cast<std::size_t>(rows));
      }
      const Diagnosis d = diagnose({window}, {"window"}, model::nominal_model("slse1"), {}).diagnosis;
      EXPECT_TRUE(d.missing.empty()) << rows << ": " << diagnosis_json(d)["missing"].dump();
      EXPECT_EQ(d.unjudged.has_value(), d.verdict == Verdict::kCannotJudge);
      unjudged_ones += d.verdict == Verdict::kCannotJudge;
    }
  }
  EXPECT_GT(unjudged_ones, 0);
}

}  // namespace
}  // namespace isorig::identify
