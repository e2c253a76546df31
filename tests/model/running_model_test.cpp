#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "model/catalogue.hpp"
#include "model/composed.hpp"
#include "model/elements.hpp"

namespace isorig::model {
namespace {

/// The force of a model that consists of one part, t_s after its start at 50 s.
double force_N(const Part& part, std::optional<double> seen_s, double t_s) {
  ModelSpec spec{.name = "alone", .parts = {part}};
  if (seen_s) {
    spec.seen.emplace();
    spec.seen->duration_s = *seen_s;
  }
  RunningModel running(spec, {});
  Instant now{.t_s = 50.0, .elongation_mm = 1.0};
  running.reset(now);
  now.t_s += t_s;
  now.dt_s = t_s;
  return running.step(now);
}

Part part_of(std::string_view physics, std::size_t law) {
  Part part = make_part(*find_physics(physics), find_physics(physics)->laws[law]);
  for (double& coefficient : part.coefficients) coefficient = 3.6;
  return part;
}

TEST(RunningModel, ADriftIsHeldWhereTheLongestRecordingEnded) {
  const Part drift = part_of("zero_drift", 0);  // 3.6 N/h, a millinewton a second
  EXPECT_NEAR(force_N(drift, 100.0, 99.0), 0.099, 1e-15);
  EXPECT_NEAR(force_N(drift, 100.0, 101.0), 0.100, 1e-15);
  EXPECT_NEAR(force_N(drift, 100.0, 1e4), 0.100, 1e-15);
  EXPECT_NEAR(force_N(drift, std::nullopt, 1e4), 10.0, 1e-12) << "written by hand: nothing says how long it was seen";
}

TEST(RunningModel, WhatCountsNoTimeGoesOn) {
  const Part arm = part_of("maxwell", 0);
  EXPECT_EQ(force_N(arm, 1.0, 30.0), force_N(arm, std::nullopt, 30.0));
}

TEST(RunningModel, ASecondStartBeginsTheTimeAnew) {
  ModelSpec spec{.name = "alone", .parts = {part_of("zero_drift", 0)}};
  spec.seen.emplace();
  spec.seen->duration_s = 100.0;
  RunningModel running(spec, {});
  Instant now{.t_s = 0.0};
  running.reset(now);
  now.t_s = now.dt_s = 500.0;
  EXPECT_NEAR(running.step(now), 0.1, 1e-15);
  now.dt_s = 0.0;
  running.reset(now);
  now.t_s += now.dt_s = 50.0;
  EXPECT_NEAR(running.step(now), 0.05, 1e-15);
}

/// Six cosines over the recording of 100 s that they were fitted to, whose id is 7.
double wander_N(double recording_id, std::vector<double> seen_in, double zero_elsewhere_N = 0.0) {
  Part part = part_of("zero_drift", 2);
  part.parameters[0] = 100.0;
  ModelSpec spec{.name = "alone", .parts = {part}};
  spec.seen.emplace();
  spec.seen->duration_s = 100.0;
  spec.seen->recordings = std::move(seen_in);
  spec.seen->zero_elsewhere_N = zero_elsewhere_N;
  RunningModel running(spec, {.recording_id = recording_id});
  Instant now{};
  running.reset(now);
  return running.step(now);
}

TEST(RunningModel, AZeroThatWandersIsThatOfItsOwnRecordings) {
  constexpr double kAllCosines_N = 6.0 * 3.6;
  EXPECT_NEAR(wander_N(7.0, {5.0, 7.0}), kAllCosines_N, 1e-12);
  EXPECT_EQ(wander_N(8.0, {5.0, 7.0}), 0.0);
  EXPECT_EQ(wander_N(0.0, {5.0, 7.0}), 0.0) << "a running rig";
  EXPECT_NEAR(wander_N(8.0, {}), kAllCosines_N, 1e-12) << "written by hand: nothing says whose it is";
  EXPECT_NEAR(wander_N(7.0, {5.0, 7.0}, 0.4), kAllCosines_N, 1e-12);
  EXPECT_EQ(wander_N(8.0, {5.0, 7.0}, 0.4), 0.4);
}

TEST(RunningModel, ATableOfTheTravelIsOfItsOwnRecordingsAndOneOfThePositionOfAll) {
  for (const auto& [law_name, elsewhere_N] : {std::pair{"travel", 0.0}, std::pair{"position", 2.0}}) {
    const Physics& tables = *find_physics("empirical_force");
    Part part = make_part(tables, *find_law(tables, law_name));
    part.table = {.first = 0.0, .step = 1.0, .values = {2.0, 2.0}};
    part.coefficients = {1.0};
    ModelSpec spec{.name = "alone", .parts = {part}};
    spec.seen.emplace();
    spec.seen->recordings = {7.0};
    for (const auto& [recording_id, force_N] : {std::pair{7.0, 2.0}, std::pair{8.0, elsewhere_N}}) {
      RunningModel running(spec, {.recording_id = recording_id});
      Instant now{};
      running.reset(now);
      EXPECT_EQ(running.step(now), force_N) << law_name << " in " << recording_id;
    }
  }
}

/// Nobody knows its phase elsewhere.
TEST(RunningModel, AWaveInTimeWithoutANameIsOfItsOwnRecordingsAndABranchOfAll) {
  for (const auto& [law_name, elsewhere_N] : {std::pair{"wave", 0.0}, std::pair{"branch", 2.0}}) {
    const Physics& memory = element::empirical_memory();
    Part part = make_part(memory, *find_law(memory, law_name));
    const auto force_N = std::ranges::find(
        part.law->coefficients, law_name == std::string_view("wave") ? "cosine_N" : "force_N", &Coefficient::name);
    ASSERT_NE(force_N, part.law->coefficients.end());
    std::ranges::fill(part.coefficients, 0.0);
    part.coefficients.at(static_cast<std::size_t>(force_N - part.law->coefficients.begin())) = 2.0;
    ModelSpec spec{.name = "alone", .parts = {part}};
    spec.seen.emplace();
    spec.seen->recordings = {7.0};
    for (const auto& [recording_id, expected_N] : {std::pair{7.0, 2.0}, std::pair{8.0, elsewhere_N}}) {
      RunningModel running(spec, {.recording_id = recording_id});
      Instant now{};
      now.position_mm = now.elongation_mm = 2.0;  // beyond the branch's upper end
      running.reset(now);
      EXPECT_EQ(running.step(now), expected_N) << law_name << " in " << recording_id;
    }
  }
}

/// A constant of 1 N, and two recordings (7 and 9) whose zeros are 0.3 and 0.6 N above that of the longest (5).
ModelSpec three_zeros(std::vector<double> seen_in) {
  ModelSpec spec{.name = "zeros", .parts = {part_of("constant", 0)}};
  spec.parts[0].coefficients = {1.0};
  for (const auto& [id, force_N] : {std::pair{7.0, 0.3}, std::pair{9.0, 0.6}}) {
    Part part = part_of("force_zero", 0);
    part.parameters[0] = id;
    part.coefficients = {force_N};
    spec.parts.push_back(part);
  }
  spec.seen.emplace();
  spec.seen->recordings = std::move(seen_in);
  spec.seen->nominal = {spec.parts[0], spec.parts[1]};
  return spec;
}

double at_rest_N(const ModelSpec& spec, double recording_id) {
  RunningModel running(spec, {.recording_id = recording_id});
  running.reset({});
  return running.step({});
}

TEST(RunningModel, ARecordingThatWasNotFittedHasTheMeanOfTheZeros) {
  const ModelSpec spec = three_zeros({5.0, 7.0, 9.0});
  EXPECT_NEAR(at_rest_N(spec, 5.0), 1.0, 1e-15);
  EXPECT_NEAR(at_rest_N(spec, 7.0), 1.3, 1e-15);
  EXPECT_NEAR(at_rest_N(spec, 9.0), 1.6, 1e-15);
  EXPECT_NEAR(at_rest_N(spec, 8.0), 1.3, 1e-15) << "(0 + 0.3 + 0.6) / 3 above the constant";
  EXPECT_NEAR(at_rest_N(spec, 0.0), 1.3, 1e-15) << "a running rig";
  EXPECT_NEAR(at_rest_N(three_zeros({}), 8.0), 1.0, 1e-15) << "written by hand: nothing says how many there were";
  EXPECT_NEAR(at_rest_N(fades_to(spec), 8.0), 1.1, 1e-15) << "the nominal model's own zeros";
  EXPECT_NEAR(at_rest_N(fades_to(spec), 7.0), 1.3, 1e-15);
}

TEST(RunningModel, OfTheMeanOfTheZerosEveryZeroHasItsShareAsColumn) {
  RunningModel running(three_zeros({5.0, 7.0, 9.0}), {.recording_id = 8.0});
  running.reset({});
  std::vector<double> columns(3);
  running.step_columns({}, columns);
  EXPECT_THAT(columns, testing::ElementsAre(1.0, testing::DoubleEq(1.0 / 3.0), testing::DoubleEq(1.0 / 3.0)));
}

}  // namespace
}  // namespace isorig::model
