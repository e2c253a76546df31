#include "identify/pooling/evidence.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace isorig::identify::pooling {
namespace {

std::vector<EffectEvidence> of(std::size_t actuator, std::size_t recordings, Says says, double probability) {
  return std::vector<EffectEvidence>(recordings, {actuator, says, probability});
}

void add(std::vector<EffectEvidence>& to, const std::vector<EffectEvidence>& more) {
  to.insert(to.end(), more.begin(), more.end());
}

TEST(Presence, ElevenOfTwelve) {
  std::vector<EffectEvidence> all;
  for (std::size_t i = 0; i < 12; ++i)
    add(all, i == 6 ? of(i, 20, Says::kNotNamed, 0.01) : of(i, 20, Says::kProbable, 0.97));
  const Presence p = pool_presence(all, 12, {});
  EXPECT_EQ(p.present(), 11U);
  EXPECT_LT(p.actuators[6].probability, 0.2);
  EXPECT_GT(p.actuators[0].probability, 0.95);
  EXPECT_GT(p.anywhere, 0.95);
  // Eleven of twelve after Beta(0.095, 1.905): the mean of Beta(11.095, 2.905) and its 2.5 % point.
  EXPECT_NEAR(p.share.value, 11.095 / 14.0, 0.01);
  EXPECT_NEAR(p.share.low95, 0.554, 0.02);
  EXPECT_LT(p.share.high95, 1.0);
}

TEST(Presence, OneActuatorThatSlipsInSomeOfItsRecordings) {
  std::vector<EffectEvidence> all;
  for (std::size_t i = 0; i < 12; ++i) add(all, of(i, 6, Says::kNotNamed, 0.01));
  for (std::size_t r = 0; r < 3; ++r) all[6 * 6 + r] = {6, Says::kProbable, 0.98};
  const Presence p = pool_presence(all, 12, {-3.0, true});
  EXPECT_EQ(p.present(), 1U);
  EXPECT_GT(p.actuators[6].probability, 0.8);
  for (std::size_t i = 0; i < 12; ++i) {
    if (i != 6) {
      EXPECT_LT(p.actuators[i].probability, 0.02) << i;
    }
  }
}

/// The prior of the diagnoses is divided out: a recording that learnt nothing states its prior, and twenty of them say
/// no more than one does.
TEST(Presence, RecordingsThatLearntNothingDoNotAddUp) {
  const EffectPriors priors{-3.0, false};
  const double prior = 1.0 / (1.0 + std::exp(3.0));
  const Presence one = pool_presence(of(0, 1, Says::kProbable, prior), 1, priors);
  const Presence many = pool_presence(of(0, 20, Says::kProbable, prior), 1, priors);
  EXPECT_NEAR(one.actuators[0].log_likelihood_ratio, 0.0, 1e-3);
  EXPECT_NEAR(many.actuators[0].log_likelihood_ratio, 0.0, 1e-3);
  EXPECT_NEAR(one.actuators[0].probability, kSurest * prior, 1e-3);
}

/// Recordings that each leave it open say together what none says alone.
TEST(Presence, EvidenceAddsUp) {
  const Presence one = pool_presence(of(0, 1, Says::kProbable, 0.4), 1, {});
  const Presence five = pool_presence(of(0, 5, Says::kProbable, 0.4), 1, {});
  EXPECT_LT(one.actuators[0].probability, 0.5);
  EXPECT_GT(five.actuators[0].probability, 0.6);
  const Presence claim = pool_presence(of(0, 1, Says::kProbable, 0.6), 1, {});
  const Presence claims = pool_presence(of(0, 5, Says::kProbable, 0.6), 1, {});
  EXPECT_LT(claim.actuators[0].probability, 0.6);
  EXPECT_GT(claims.actuators[0].probability, 0.95);
}

/// A misfit that all recordings share gives each a little evidence for the same effect: three to one in 240 of them is
/// no certainty.
TEST(Presence, AMisfitOfAllRecordingsDoesNotAddUpToAName) {
  std::vector<EffectEvidence> all;
  const double odds = 3.0 * std::exp(-3.0);
  for (std::size_t i = 0; i < 12; ++i) add(all, of(i, 20, Says::kProbable, odds / (1.0 + odds)));
  EXPECT_EQ(pool_presence(all, 12, {}).present(), 0U);
}

/// No number of recordings is surer than the calibration of the diagnosis, whatever each states.
TEST(Presence, NoMoreSureThanTheCalibration) {
  std::vector<EffectEvidence> all;
  for (std::size_t i = 0; i < 50; ++i) add(all, of(i, 40, Says::kProbable, 1.0));
  const Presence p = pool_presence(all, 50, {});
  for (const auto& actuator : p.actuators) EXPECT_LE(actuator.probability, kSurest);
  EXPECT_LE(p.anywhere, kSurest);
}

TEST(Presence, WhatSaysNothingIsCountedApart) {
  std::vector<EffectEvidence> all = of(0, 4, Says::kNothing, 0.0);
  add(all, of(1, 4, Says::kNotNamed, 0.01));
  const Presence p = pool_presence(all, 2, {});
  EXPECT_EQ(p.judged(), 1U);
  EXPECT_EQ(p.actuators[0].unjudged, 4U);
  EXPECT_DOUBLE_EQ(p.actuators[0].log_likelihood_ratio, 0.0);
  EXPECT_LT(p.actuators[1].log_likelihood_ratio, -2.0);
}

/// Names whose law fails on left-out readings are wrong alike: ten of them weigh as much as one.
TEST(Presence, RefusedNamesCountOnce) {
  const Presence one = pool_presence(of(0, 1, Says::kRefused, 0.5), 1, {});
  const Presence ten = pool_presence(of(0, 10, Says::kRefused, 0.5), 1, {});
  EXPECT_DOUBLE_EQ(ten.actuators[0].log_likelihood_ratio, one.actuators[0].log_likelihood_ratio);
}

/// What most actuators have is likelier in the next.
TEST(Presence, ActuatorsLendEachOtherEvidence) {
  std::vector<EffectEvidence> alone = of(0, 1, Says::kProbable, 0.3), among = alone;
  for (std::size_t i = 1; i < 12; ++i) add(among, of(i, 3, Says::kProbable, 0.97));
  EXPECT_GT(pool_presence(among, 12, {}).actuators[0].probability, 0.9);
  EXPECT_LT(pool_presence(alone, 1, {}).actuators[0].probability, 0.5);
}

}  // namespace
}  // namespace isorig::identify::pooling
