#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/text_file.hpp"
#include "proof/baselines/baseline.hpp"
#include "proof/generator/case.hpp"
#include "proof/scoring/runner.hpp"
#include "proof/scoring/table.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;

Label label(std::string category, std::vector<std::string> effects, double size = 1.0, std::string trap = "none") {
  Label l;
  l.name = "case";
  l.category = std::move(category);
  l.effects = std::move(effects);
  l.size = size;
  l.trap = std::move(trap);
  return l;
}

Outcome said(std::string verdict, std::vector<Claim> missing, double nominal_rmse_N = 1.0, double model_rmse_N = 0.0) {
  Outcome o;
  o.verdict = std::move(verdict);
  o.missing = std::move(missing);
  o.nominal_rmse_N = nominal_rmse_N;
  o.model_rmse_N = model_rmse_N;
  return o;
}

MATCHER_P2(Is, hits, of, "") {
  return arg.hits == static_cast<std::size_t>(hits) && arg.of == static_cast<std::size_t>(of);
}

TEST(ProofScore, CountsWhatTheDefinitionsSay) {
  const std::vector<Label> labels{
      label("null", {}),
      label("null", {}, 1.0, "outliers"),
      label("single", {"slack"}),
      label("single", {"force_lag"}, 0.5),
      label("single", {"zero_drift"}, 0.25),
      label("pair", {"slack", "force_lag"}),
      label("pair", {"slack", "zero_drift"}),
      label("confusable", {"force_lag", "force_delay"}),
      label("out_of_catalogue", {"screw_ripple"}),
      label("out_of_catalogue", {"thixotropy"}),
      label("background", {"grip_slip"}),
  };
  const std::vector<Outcome> outcomes{
      said("consistent", {}),
      said("missing_physics", {{"zero_drift", 0.6}}),
      said("missing_physics", {{"slack", 0.98}, {"force_lag", 0.95}}, 1.0, 0.1),
      said("missing_physics", {{"force_delay", 0.7}, {"force_lag", 0.3}}, 1.0, 0.2),
      said("consistent", {}, 1.0, 1.0),
      said("missing_physics", {{"force_lag", 0.99}, {"slack", 0.97}}, 1.0, 0.3),
      said("missing_physics", {{"slack", 0.97}}, 1.0, 0.4),
      said("missing_physics", {{"force_lag", 0.9}, {"force_delay", 0.8}, {"slack", 0.2}}, 1.0, 0.5),
      said("unknown_physics", {}, 1.0, 0.6),
      said("missing_physics", {{"cyclic_softening", 0.93}}, 1.0, 0.7),
      said("missing_physics", {{"grip_slip", 1.0}}, 1.0, 0.8),
  };
  const Score s = score("tool", labels, outcomes);
  EXPECT_THAT(s.false_alarms, Is(1, 2));
  EXPECT_THAT(s.clean_false_alarms, Is(0, 1));
  EXPECT_THAT(s.first_full, Is(1, 1));
  EXPECT_THAT(s.first_half, Is(0, 1));
  EXPECT_THAT(s.first_quarter, Is(0, 1));
  EXPECT_THAT(s.first_all, Is(1, 3));
  EXPECT_THAT(s.missed, Is(1, 3));
  EXPECT_THAT(s.pairs_complete, Is(1, 2));
  EXPECT_THAT(s.pairs_exact, Is(1, 2));
  EXPECT_THAT(s.confusable_complete, Is(1, 1));
  EXPECT_THAT(s.confusable_exact, Is(0, 1));
  EXPECT_THAT(s.unknown_called, Is(1, 2));
  EXPECT_THAT(s.unknown_wrong_sure, Is(1, 2));
  EXPECT_THAT(s.background_first, Is(1, 1));
  EXPECT_THAT(s.wrong_sure, Is(2, 11));
  EXPECT_EQ(s.gaps.size(), 9U);
  EXPECT_NEAR(s.median_gap, 0.5, 1e-12);
  const std::string text = table_text(std::vector{s});
  EXPECT_THAT(text, testing::HasSubstr("1/3"));
  EXPECT_EQ(score_json(std::vector{s}).at("methods").at(0).at("wrong_sure").at("hits"), 2);
}

TEST(ProofScore, AcceptsTheNamesOfOneThingAndWhatIsFaintlyThere) {
  Label lag = label("single", {"force_lag"});
  lag.accepted = {{"force_delay"}};
  Label faint = label("background", {"slack"});
  faint.background = {"second_relaxation"};
  Label outside = label("out_of_catalogue", {"unknown"});
  outside.accepted = {{"strain_stiffening"}};
  const Label triple = label("triple", {"slack", "force_lag", "zero_drift"});
  const std::vector<Label> labels{lag, faint, outside, outside, triple, triple};
  const std::vector<Outcome> outcomes{
      said("missing_physics", {{"force_delay", 0.95}}),
      said("missing_physics", {{"slack", 0.95}, {"second_relaxation", 0.95}}),
      said("missing_physics", {{"strain_stiffening", 0.95}}),
      said("missing_physics", {{"strain_stiffening", 0.95}, {"slack", 0.95}}, 1.0, 1.01),
      said("missing_physics", {{"slack", 0.5}, {"force_lag", 0.5}, {"zero_drift", 0.5}}),
      said("missing_physics", {{"slack", 0.5}, {"force_lag", 0.5}}),
  };
  const Score s = score("tool", labels, outcomes);
  EXPECT_THAT(s.first_all, Is(1, 1));
  EXPECT_THAT(s.background_first, Is(1, 1));
  EXPECT_THAT(s.unknown_called, Is(0, 2));
  EXPECT_THAT(s.unknown_or_half, Is(1, 2));
  EXPECT_THAT(s.wrong_sure, Is(1, 6));
  EXPECT_THAT(s.sure_right, Is(5, 6));
  EXPECT_THAT(s.worse, Is(1, 6));
  EXPECT_THAT(s.triples_complete, Is(1, 2));
  EXPECT_THAT(s.triples_exact, Is(1, 2));
}

TEST(ProofScore, IntervalsAreWilsons) {
  // At the ends the interval is n / (n + z^2) wide, z^2 = 3.8415.
  EXPECT_NEAR(wilson({22, 22}).low, 22.0 / 25.8415, 1e-4);
  EXPECT_NEAR(wilson({22, 22}).high, 1.0, 1e-12);
  EXPECT_NEAR(wilson({0, 10}).high, 3.8415 / 13.8415, 1e-4);
  EXPECT_NEAR(wilson({5, 10}).low, 0.2366, 1e-4);  // Newcombe 1998
  EXPECT_EQ(wilson({0, 0}).high, 1.0);
}

TEST(ProofScore, CalibrationOfHandMadeClaims) {
  // Ten claims of 0.9: nine right. One of 0.6: wrong.
  std::vector<Label> labels(11, label("single", {"slack"}));
  labels[9].effects = {"zero_drift"};
  labels[10].effects = {"zero_drift"};
  std::vector<Outcome> outcomes(10, said("missing_physics", {{"slack", 0.9}}));
  outcomes.push_back(said("missing_physics", {{"slack", 0.6}}));
  const Score s = score("tool", labels, outcomes);
  EXPECT_NEAR(s.brier, (9 * 0.01 + 0.81 + 0.36) / 11.0, 1e-12);
  EXPECT_NEAR(s.calibration_error, 0.6 / 11.0, 1e-12);
  std::size_t claims = 0;
  for (const ReliabilityBin& bin : s.reliability) {
    claims += bin.claims;
    if (bin.claims == 10) {
      EXPECT_NEAR(bin.right, 0.9, 1e-12);
    }
  }
  EXPECT_EQ(claims, 11U);
}

TEST(ProofScore, NoiseIsTakenOutOfErrorsAgainstRecordedForce) {
  EXPECT_NEAR(gap_closed(said("", {}, 0.5, 0.05), 0.0), 0.9, 1e-12);
  EXPECT_NEAR(gap_closed(said("", {}, 0.5, 0.3), 0.3), 1.0, 1e-12);
  EXPECT_NEAR(gap_closed(said("", {}, 0.5, std::sqrt(0.3 * 0.3 + 0.2 * 0.2)), 0.3), 0.5, 1e-12);
}

TEST(ProofLabels, OfOthersAreReadInTheirOwnForms) {
  const auto by_name = parse_foreign_labels(
      R"({"b": {"effects": ["slack"], "nominal": "slse2", "noise_N": 0.02},
          "a": {"effects": [], "nominal": "slse1", "noise_N": 0.03}})");
  ASSERT_EQ(by_name.size(), 2U);
  EXPECT_EQ(by_name[0].category, "null");
  EXPECT_EQ(by_name[1].effects, std::vector<std::string>{"slack"});
  const auto listed = parse_foreign_labels(
      R"({"cases": [{"case": "c", "concealed": [{"effect": "slack"}, {"effect": "force_lag"}], "model": "slse1", "noise": 0.1}]})");
  EXPECT_EQ(listed.at(0).category, "pair");
  const auto strange = parse_foreign_labels(
      R"({"a": {"kind": "outside", "labels": ["slack"], "model": "slse1", "noise_N": 0.02},
          "b": {"kind": "single", "labels": ["pitch_error"], "model": "slse1", "noise_N": 0.02},
          "c": {"kind": "single", "labels": ["slack"], "model": "slse1", "noise_N": 0.02},
          "d": {"kind": "background", "labels": ["slack"], "model": "slse1", "noise_N": 0.02}})");
  EXPECT_EQ(strange.at(0).category, "out_of_catalogue");
  EXPECT_EQ(strange.at(1).category, "out_of_catalogue");
  EXPECT_EQ(strange.at(2).category, "single");
  EXPECT_EQ(strange.at(3).category, "background");
  // Called unknown is what is asked of them; they are no single that was missed.
  const Score strange_score = score("tool", {strange[1]}, {said("unknown_physics", {})});
  EXPECT_EQ(strange_score.first_all.of, 0U);
  EXPECT_EQ(strange_score.unknown_called.hits, 1U);
  EXPECT_THAT([] { (void)parse_foreign_labels(R"({"a": {"what": 1}})"); },
              testing::ThrowsMessage<std::runtime_error>(testing::HasSubstr("what")));
}

/// Who fails is no better off than who predicts badly.
TEST(ProofScore, AFailureCountsAgainstTheTool) {
  Outcome failed = said("missing_physics", {{"slack", 0.95}}, 1.0, NAN);
  failed.failed = true;
  const std::vector<Label> labels(4, label("single", {"slack"}));
  const std::vector<Outcome> outcomes{failed, said("missing_physics", {{"slack", 0.95}}, 1.0, NAN),
                                      said("missing_physics", {{"slack", 0.95}}, 1.0, 1.0),
                                      said("missing_physics", {{"slack", 0.95}}, 1.0, 0.5)};
  const Score s = score("tool", labels, outcomes);
  EXPECT_THAT(s.worse, Is(2, 4)) << "one that failed, one that predicted no number";
  EXPECT_THAT(s.first_all, Is(3, 4)) << "a name beside a prediction that failed";
  // Perfect by the nominal model, and not by the tool's: no finite gap, and below any other.
  const Score opened = score(
      "tool", std::vector<Label>(3, label("single", {"slack"})),
      {said("", {}, 0.0, 0.5), said("", {}, 1.0, std::numeric_limits<double>::infinity()), said("", {}, 1.0, 0.1)});
  ASSERT_EQ(opened.gaps.size(), 3U);
  EXPECT_EQ(opened.gaps[0], -std::numeric_limits<double>::infinity());
  EXPECT_EQ(opened.median_gap, -std::numeric_limits<double>::infinity());
  EXPECT_THAT(table_text(std::vector{opened}), testing::HasSubstr("-inf"));
}

TEST(ProofRunner, CollectsADiagnosisWithItsPredictions) {
  const fs::path folder = fs::temp_directory_path() / ("isorig-proof-collect-" + std::to_string(getpid()));
  write_text(folder / "run.json", R"({"exit_code": 0, "wall_s": 1.5, "cpu_s": 2.5})");
  write_text(folder / "diagnosis.json",
             R"({"verdict": "missing_physics", "missing": [{"effect": "slack", "probability": 0.97}],
                 "alternatives": [{"effects": ["zero_drift"], "probability": 0.02}]})");
  write_text(folder / "nominal.csv", "t_s,force_N\n0,1\n1,1\n");
  write_text(folder / "model.csv", "t_s,force_N\n0,3\n1,2\n");
  const Outcome outcome = collect(folder, {3.0, 3.0});
  EXPECT_FALSE(outcome.failed) << outcome.why;
  EXPECT_EQ(outcome.missing.at(0).effect, "slack");
  EXPECT_EQ(outcome.alternatives.at(0).effects.at(0), "zero_drift");
  EXPECT_NEAR(outcome.nominal_rmse_N, 2.0, 1e-12);
  EXPECT_NEAR(outcome.model_rmse_N, std::sqrt(0.5), 1e-12);
  EXPECT_EQ(outcome.cpu_s, 2.5);
  EXPECT_TRUE(collect(folder, {3.0}).failed);  // a prediction of another length is no prediction
  write_text(folder / "run.json", R"({"exit_code": 9, "wall_s": 1.5, "cpu_s": 2.5})");
  EXPECT_TRUE(collect(folder, {3.0, 3.0}).failed);
  EXPECT_EQ(collect(folder, {3.0, 3.0}).cpu_s, 2.5) << "what it took before it failed";
  fs::remove_all(folder);
  EXPECT_TRUE(collect(folder, {3.0, 3.0}).failed);
}

/// A short session with friction: the simple methods see it. (What greedy BIC piles on it need not predict.)
TEST(ProofBaselines, GreedyBicFindsPlainFriction) {
  Case c;
  c.name = "case-000";
  c.nominal = "slse1";
  c.clean.specimen = {90.0, 80.0, 2.0, {{1.5, 0.8}}};
  c.rig = c.clean;
  c.rig.hidden.friction_N = 1.0;
  c.train_protocol = {{4.0, 10.0}, 2.0, 4.0, 0.2, 5.0};
  c.heldout_protocol.velocities_mm_s = {6.0};
  const MadeRecording train = record(c, Part::kTrain, 5);
  const MadeRecording heldout = record(c, Part::kHeldout, 5);
  const auto outcomes = run_baselines(train.recording, heldout.recording, "slse1", heldout.truth_N, c.name);
  ASSERT_EQ(outcomes.size(), baselines().size());
  const Outcome& greedy = outcomes[1];
  ASSERT_FALSE(greedy.missing.empty());
  EXPECT_EQ(greedy.missing[0].effect, "coulomb_friction");
  EXPECT_GT(greedy.missing[0].probability, 0.99);
  EXPECT_EQ(outcomes[0].model_rmse_N, outcomes[0].nominal_rmse_N);  // chance predicts nothing
  EXPECT_TRUE(outcomes[4].missing.empty());
  EXPECT_EQ(outcomes[4].verdict, "unknown_physics");
}

TEST(ProofScore, ReadsAPredictionWithAndWithoutItsBand) {
  const fs::path file = fs::temp_directory_path() / ("prediction-" + std::to_string(::getpid()) + ".csv");
  write_text(file, "t_s,force_N\n0,1\n1,2\n");
  EXPECT_DOUBLE_EQ(prediction_rmse_N(file, {1.0, 4.0}), std::sqrt(2.0));
  write_text(file, "t_s,force_N,low95_N,high95_N,outside\n0,1,0,2,0\n1,2,1,3,0.5\n");
  EXPECT_DOUBLE_EQ(prediction_rmse_N(file, {1.0, 4.0}), std::sqrt(2.0));
  fs::remove(file);
}

TEST(ProofScore, WhatCannotBeJudgedIsNeitherAnAlarmNorAMiss) {
  const std::vector<Label> labels{label("null", {}), label("single", {"slack"})};
  const Score s = score("isorig", labels, {said("cannot_judge", {}), said("cannot_judge", {})});
  EXPECT_THAT(s.false_alarms, Is(0, 1));
  EXPECT_THAT(s.missed, Is(0, 1));
  EXPECT_THAT(s.unjudged, Is(2, 2));
}

}  // namespace
}  // namespace isorig::proof
