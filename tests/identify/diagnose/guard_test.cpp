// Faults of the data put in at known places: found, placed and left out, and never found where there are
// none.
#include "identify/diagnose/guard/guard.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/guard/pressure_coverage.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

const messages::Recording& clean() {
  static const messages::Recording recording = test::record({});
  return recording;
}

/// First row at or after `t_s`.
std::size_t row_at(const messages::Recording& recording, double t_s) {
  const auto& t = recording.frame.t_s;
  return static_cast<std::size_t>(std::ranges::lower_bound(t, t_s) - t.begin());
}

/// Rows of the first dense stretch (200 Hz): a ramp and its first seconds.
std::size_t dense_row(const messages::Recording& recording) {
  const auto& t = recording.frame.t_s;
  std::size_t k = 1;
  while (t[k] - t[k - 1] > 0.01 || t[k + 400] - t[k + 399] > 0.01) ++k;
  return k;
}

std::vector<std::string> kinds(const Guarded& guarded) {
  std::vector<std::string> out;
  for (const DataFault& fault : guarded.faults) out.push_back(fault.kind);
  return out;
}

std::set<std::size_t> lost(const Guarded& guarded) {
  std::set<std::size_t> out;
  for (std::size_t k = 0; k < guarded.usable.size(); ++k)
    if (!guarded.usable[k]) out.insert(k);
  return out;
}

std::string said(const Guarded& guarded) {
  std::string out;
  for (const DataFault& fault : guarded.faults)
    out += fault.kind + " " + std::to_string(fault.t_start_s) + ".." + std::to_string(fault.t_end_s) + ": " +
           fault.text + "\n";
  return out;
}

/// Everything an instrument and a specimen do, and no fault.
class Clean : public testing::TestWithParam<test::ConcealedSpecimen> {};
TEST_P(Clean, HasNoFault) {
  const Guarded guarded = guard_recording(test::record(GetParam()));
  EXPECT_TRUE(guarded.faults.empty()) << said(guarded);
  EXPECT_TRUE(lost(guarded).empty());
}
INSTANTIATE_TEST_SUITE_P(
    ConcealedSpecimen, Clean,
    testing::Values(test::ConcealedSpecimen{}, test::ConcealedSpecimen{.seed = 2},
                    test::ConcealedSpecimen{.friction_N = 0.8, .seed = 3},
                    test::ConcealedSpecimen{.gap_mm = 0.08, .seed = 4},
                    test::ConcealedSpecimen{.slip_mm = 0.2, .slip_s = 500.3}, test::ConcealedSpecimen{.mass_kg = 0.5},
                    test::ConcealedSpecimen{.elongation_at_zero_mm = 2.5, .slack = true},
                    test::ConcealedSpecimen{.coloured_N = 0.06, .seed = 5},
                    test::ConcealedSpecimen{.force_noise_N = 2e-3}, test::ConcealedSpecimen{.lag_s = 0.03},
                    test::ConcealedSpecimen{.force_step_N = 0.02}, test::ConcealedSpecimen{.drift_N_h = 2.0}));

TEST(Guard, FindsSingleOutliersAndLeavesOutNoOtherReading) {
  messages::Recording recording = clean();
  std::set<std::size_t> put;
  std::mt19937 random(9);
  while (put.size() < 20) {
    const std::size_t k = 20 + random() % (recording.frame.size() - 40);
    if (std::ranges::any_of(put, [k](std::size_t other) { return other + 12 > k && k + 12 > other; })) continue;
    put.insert(k);
    recording.frame.force_N[k] += put.size() % 2 == 0 ? 0.8 : -0.5;  // 25 to 40 times the noise
  }
  const Guarded guarded = guard_recording(recording);
  EXPECT_EQ(lost(guarded), put);
  ASSERT_EQ(kinds(guarded), std::vector<std::string>{"outliers"}) << said(guarded);
  EXPECT_EQ(guarded.faults[0].rows, 20U);
  EXPECT_EQ(guarded.faults[0].t_start_s, recording.frame.t_s[*put.begin()]);
  EXPECT_EQ(guarded.faults[0].t_end_s, recording.frame.t_s[*put.rbegin()]);
  EXPECT_NE(guarded.faults[0].text.find("20 force readings"), std::string::npos);
}

/// At 50 readings a second a mass that starts to move is a reading or two off its neighbours, at each start and stop.
TEST(Guard, SaysOfJumpsThatTheyStandWhereTheMotionTurns) {
  constexpr double kMass_kg = 20.0;
  messages::Recording heavy =
      test::record({.force_noise_N = 0.005, .position_noise_mm = 1e-5, .fast_interval_s = 0.02});
  const auto& [t_s, x_mm] = std::tie(heavy.frame.t_s, heavy.frame.position_mm);
  for (std::size_t k = 1; k + 1 < heavy.frame.size(); ++k) {
    const double before_s = t_s[k] - t_s[k - 1], after_s = t_s[k + 1] - t_s[k];
    if (before_s + after_s > 0.05) continue;  // read seldom: the crosshead rests or creeps
    const double change_mm_s = (x_mm[k + 1] - x_mm[k]) / after_s - (x_mm[k] - x_mm[k - 1]) / before_s;
    heavy.frame.force_N[k] += kMass_kg * 1e-3 * change_mm_s / (0.5 * (before_s + after_s));
  }
  const auto told = [](const messages::Recording& recording) { return said(guard_recording(recording)); };
  EXPECT_NE(told(heavy).find("where the motion turns"), std::string::npos) << told(heavy);
  // As many jumps at any places do not.
  messages::Recording struck = test::record({.force_noise_N = 0.005, .fast_interval_s = 0.02});
  for (std::size_t k = 40; k + 40 < struck.frame.size(); k += 97) struck.frame.force_N[k] += 1.0;
  EXPECT_NE(told(struck).find("jump away"), std::string::npos);
  EXPECT_EQ(told(struck).find("where the motion turns"), std::string::npos) << told(struck);
}

/// Bursts of two to four readings, one-sided and two-sided, in a ramp and in a hold.
TEST(Guard, FindsBurstsOfOutliers) {
  messages::Recording recording = clean();
  std::set<std::size_t> put;
  const auto burst = [&](std::size_t from, std::initializer_list<double> sizes_N) {
    for (const double size_N : sizes_N) {
      recording.frame.force_N[from] += size_N;
      put.insert(from++);
    }
  };
  const std::size_t dense = dense_row(recording);
  burst(dense + 300, {0.9, 1.1});
  burst(dense + 350, {1.0, -1.2, 0.8});
  burst(row_at(recording, 330.0), {-0.9, -1.0, -1.1});
  std::size_t rest = row_at(recording, 600.0);  // in motion four in a row could be a step of the specimen's
  while (std::fabs(recording.frame.position_mm[rest + 10] - recording.frame.position_mm[rest - 6]) > 0.005) ++rest;
  burst(rest, {1.0, 1.5, 1.2, 0.9});
  const Guarded guarded = guard_recording(recording);
  for (const std::size_t k : put) EXPECT_FALSE(guarded.usable[k]) << "row " << k;
  EXPECT_LE(lost(guarded).size(), put.size() + 4);
  ASSERT_EQ(kinds(guarded), std::vector<std::string>{"outliers"}) << said(guarded);
}

class Saturated : public testing::TestWithParam<bool> {};
TEST_P(Saturated, IsFoundAtThisEnd) {
  messages::Recording recording = clean();
  auto& force = recording.frame.force_N;
  std::vector<double> sorted = force;
  std::ranges::sort(sorted);
  const double limit = sorted[sorted.size() * (GetParam() ? 93 : 7) / 100];
  std::set<std::size_t> clipped, near;
  const double noise_N = recording_quality(recording).force.noise;
  for (std::size_t k = 0; k < force.size(); ++k) {
    // Within the noise of the limit a reading is clipped as often as not: those that were not clip the mean's noise.
    if (std::fabs(force[k] - limit) < 4.5 * noise_N) near.insert(k);
    if (GetParam() ? force[k] <= limit : force[k] >= limit) continue;
    force[k] = limit;
    clipped.insert(k);
  }
  const Guarded guarded = guard_recording(recording);
  std::size_t found = 0;
  for (const std::size_t k : clipped) found += guarded.usable[k] ? 0 : 1;
  // Where the force only grazes the limit it stands there for less than a dozen readings.
  EXPECT_GT(found, clipped.size() * 9 / 10);
  for (const std::size_t k : lost(guarded)) EXPECT_TRUE(clipped.contains(k) || near.contains(k)) << "row " << k;
  for (const std::string& kind : kinds(guarded)) EXPECT_EQ(kind, "saturation") << said(guarded);
  ASSERT_FALSE(guarded.faults.empty());
  for (const DataFault& fault : guarded.faults) {
    const std::size_t first = row_at(recording, fault.t_start_s);
    EXPECT_TRUE(clipped.contains(first) || near.contains(first));
    EXPECT_NE(fault.text.find("end of its range"), std::string::npos);
  }
}
INSTANTIATE_TEST_SUITE_P(Guard, Saturated, testing::Bool(),
                         [](const auto& upper) { return upper.param ? "upper" : "lower"; });

/// The load cell's cable is out for a while: its reading stands at 0 N, or at what it was.
TEST(Guard, FindsALoadCellThatStandsStill) {
  for (const bool at_zero : {true, false}) {
    messages::Recording recording = clean();
    const std::size_t ramp = dense_row(recording) + 50, rest = row_at(recording, 600.0);
    for (const auto& [from, count] : {std::pair{ramp, std::size_t{300}}, std::pair{rest, std::size_t{60}}})
      for (std::size_t k = from; k < from + count; ++k)
        recording.frame.force_N[k] = at_zero ? 0.0 : recording.frame.force_N[from];
    const Guarded guarded = guard_recording(recording);
    ASSERT_EQ(guarded.faults.size(), 2U) << said(guarded);
    for (const DataFault& fault : guarded.faults)
      EXPECT_TRUE(fault.kind == "frozen" || (at_zero && fault.kind == "saturation")) << said(guarded);
    EXPECT_EQ(guarded.faults[0].t_start_s, recording.frame.t_s[ramp]);
    EXPECT_EQ(guarded.faults[0].t_end_s, recording.frame.t_s[ramp + 299]);
    EXPECT_EQ(guarded.faults[0].rows, 300U);
    EXPECT_EQ(guarded.faults[1].t_start_s, recording.frame.t_s[rest]);
    EXPECT_EQ(guarded.faults[1].rows, 60U);
    EXPECT_EQ(lost(guarded).size(), 360U);
  }
}

TEST(Guard, FindsAPositionThatStandsStillWhileItsNoiseShouldMoveIt) {
  messages::Recording recording = clean();
  const std::size_t from = dense_row(recording) + 50;
  for (std::size_t k = from; k < from + 300; ++k) recording.frame.position_mm[k] = recording.frame.position_mm[from];
  const Guarded guarded = guard_recording(recording);
  ASSERT_EQ(kinds(guarded), std::vector<std::string>{"frozen"}) << said(guarded);
  EXPECT_NE(guarded.faults[0].text.find("position"), std::string::npos);
  EXPECT_EQ(guarded.faults[0].t_start_s, recording.frame.t_s[from]);
  EXPECT_EQ(guarded.faults[0].rows, 300U);
  EXPECT_EQ(lost(guarded).size(), 300U);
}

TEST(Guard, FindsAPressureThatStandsStill) {
  messages::Recording recording = clean();
  auto& gauge = *recording.pressure;
  const std::size_t from = gauge.size() / 3;
  for (std::size_t k = from; k < from + 200; ++k) gauge.pressure_psi[k] = gauge.pressure_psi[from];
  const Guarded guarded = guard_recording(recording);
  ASSERT_EQ(kinds(guarded), std::vector<std::string>{"frozen"}) << said(guarded);
  EXPECT_NE(guarded.faults[0].text.find("pressure"), std::string::npos);
  EXPECT_EQ(guarded.faults[0].t_start_s, gauge.t_s[from]);
  EXPECT_EQ(guarded.faults[0].t_end_s, gauge.t_s[from + 199]);
  EXPECT_TRUE(lost(guarded).empty()) << "the force is as good as ever";
}

/// An encoder or a gauge that counts more coarsely than its noise stands still by right.
TEST(Guard, AllowsACoarseReadingToStandStill) {
  messages::Recording recording = clean();
  for (double& x : recording.frame.position_mm) x = std::round(x / 0.005) * 0.005;
  for (double& p : recording.pressure->pressure_psi) p = std::round(p / 0.05) * 0.05;
  const Guarded guarded = guard_recording(recording);
  EXPECT_TRUE(guarded.faults.empty()) << said(guarded);
}

/// Steps of once to four times the noise: such a reading often repeats itself, in a hold for long.
TEST(Guard, DoesNotTakeACoarseForceForAFrozenOne) {
  for (const double noise_N : {0.005, 0.0071, 0.01, 0.0125, 0.02}) {
    messages::Recording recording = test::record({.force_noise_N = noise_N, .force_step_N = 0.02});
    for (double& x : recording.frame.position_mm) x = std::round(x / 8e-4) * 8e-4;
    for (const DataFault& fault : guard_recording(recording).faults)
      EXPECT_EQ(fault.kind, "quantisation") << "noise " << noise_N << ": " << fault.text;
  }
}

TEST(Guard, FindsAGapAndAClockThatJumps) {
  for (const bool jump : {false, true}) {
    messages::Recording recording = clean();
    auto& frame = recording.frame;
    const std::size_t at = row_at(recording, 500.0);
    if (jump) {
      for (std::size_t k = at; k < frame.size(); ++k) frame.t_s[k] += 7.0;
      for (double& t_s : recording.pressure->t_s) t_s += t_s < 500.0 ? 0.0 : 7.0;
    } else {
      const std::size_t end = row_at(recording, 530.0);
      for (auto* column : {&frame.t_s, &frame.position_mm, &frame.force_N})
        column->erase(column->begin() + static_cast<std::ptrdiff_t>(at),
                      column->begin() + static_cast<std::ptrdiff_t>(end));
    }
    const Guarded guarded = guard_recording(recording);
    ASSERT_EQ(kinds(guarded), std::vector<std::string>{"gap"}) << said(guarded);
    EXPECT_EQ(guarded.faults[0].t_start_s, frame.t_s[at - 1]);
    EXPECT_EQ(guarded.faults[0].t_end_s, frame.t_s[at]);
    EXPECT_TRUE(lost(guarded).empty());
  }
}

// One row in a hundred is written while the specimen rests, fifty times as far apart as those of the motion.
TEST(Guard, RestsThatAreWrittenLessOftenAreNoGaps) {
  messages::Recording recording = clean();
  messages::FrameSamples frame;
  for (double t_s = 0.0; t_s < 60.0; t_s += t_s < 30.0 ? 0.15 : 0.003) {
    frame.t_s.push_back(t_s);
    frame.position_mm.push_back(t_s < 30.0 ? 0.0 : 4.0 * std::sin(t_s - 30.0));
    frame.force_N.push_back(std::sin(1e4 * t_s));
  }
  recording.frame = std::move(frame);
  for (const DataFault& fault : guard_recording(recording).faults) EXPECT_NE(fault.kind, "gap") << fault.text;
}

TEST(Guard, FindsReadingsCoarserThanTheirNoise) {
  messages::Recording recording = clean();
  for (double& force_N : recording.frame.force_N) force_N = std::round(force_N / 0.2) * 0.2;
  const Guarded guarded = guard_recording(recording);
  ASSERT_EQ(kinds(guarded), std::vector<std::string>{"quantisation"}) << said(guarded);
  EXPECT_NE(guarded.faults[0].text.find("0.2 N"), std::string::npos) << guarded.faults[0].text;
  EXPECT_TRUE(lost(guarded).empty());
}

TEST(Guard, FindsSeveralFaultsAtOnce) {
  messages::Recording recording = clean();
  auto& frame = recording.frame;
  const std::size_t still = row_at(recording, 300.0), spike = row_at(recording, 700.0);
  for (std::size_t k = still; k < still + 40; ++k) frame.force_N[k] = frame.force_N[still];
  frame.force_N[spike] += 2.0;
  const std::size_t at = row_at(recording, 900.0);
  for (std::size_t k = at; k < frame.size(); ++k) frame.t_s[k] += 30.0;
  for (double& t_s : recording.pressure->t_s) t_s += t_s < 900.0 ? 0.0 : 30.0;
  const Guarded guarded = guard_recording(recording);
  std::vector<std::string> found = kinds(guarded);
  std::ranges::sort(found);
  EXPECT_EQ(found, (std::vector<std::string>{"frozen", "gap", "outliers"})) << said(guarded);
  EXPECT_EQ(lost(guarded).size(), 41U);
}

TEST(Guard, TakesARecordingTooShortToJudgeAsItIs) {
  messages::Recording recording = clean();
  for (auto* column : {&recording.frame.t_s, &recording.frame.position_mm, &recording.frame.force_N})
    column->resize(19);
  recording.frame.force_N[5] += 100.0;
  EXPECT_TRUE(guard_recording(recording).faults.empty());
}

/// From a third of the time on the gauge is dead: what the force depends on is not known there.
TEST(Guard, WhatNobodyReadThePressureOfIsLeftOutAndSaid) {
  messages::Recording half = clean();
  ASSERT_TRUE(half.pressure);
  EXPECT_TRUE(unread_pressure(half).empty());
  const double begin_s = half.frame.t_s.front(), end_s = half.frame.t_s.back(),
               dead_s = begin_s + (end_s - begin_s) / 3.0;
  messages::PressureSamples& gauge = *half.pressure;
  const auto kept = static_cast<std::size_t>(std::ranges::lower_bound(gauge.t_s, dead_s) - gauge.t_s.begin());
  gauge.t_s.resize(kept);
  gauge.pressure_psi.resize(kept);
  const auto unread = unread_pressure(half);
  ASSERT_EQ(unread.size(), 1U);
  EXPECT_NEAR(unread[0].from_s, gauge.t_s.back() + 1.0, 1e-9);
  EXPECT_NEAR(unread[0].to_s, end_s, 1e-9);
  const Guarded guarded = guard_recording(half);
  const auto fault = std::ranges::find(guarded.faults, std::string("pressure"), &DataFault::kind);
  ASSERT_NE(fault, guarded.faults.end());
  EXPECT_NE(fault->text.find("pressure.csv has no readings for "), fault->text.npos) << fault->text;
  const std::size_t first = row_at(half, unread[0].from_s);
  EXPECT_EQ(fault->rows, half.frame.size() - first);
  for (std::size_t k = first; k < half.frame.size(); ++k) ASSERT_FALSE(guarded.usable[k]) << k;
  EXPECT_TRUE(guarded.usable[row_at(half, begin_s + 10.0)]);
  // A second that is missing is bridged; a recording without a gauge has nothing to miss.
  messages::Recording whole = clean();
  const auto at = static_cast<std::ptrdiff_t>(whole.pressure->t_s.size() / 2);
  const auto last =
      std::ranges::lower_bound(whole.pressure->t_s, whole.pressure->t_s[static_cast<std::size_t>(at)] + 0.9) -
      whole.pressure->t_s.begin();
  whole.pressure->t_s.erase(whole.pressure->t_s.begin() + at, whole.pressure->t_s.begin() + last);
  EXPECT_TRUE(unread_pressure(whole).empty());
  whole.pressure.reset();
  EXPECT_TRUE(unread_pressure(whole).empty());
}

/// Two clocks: nothing of the gauge belongs to any row.
TEST(Guard, AGaugeOfAnotherTimeIsRefused) {
  messages::Recording shifted = clean();
  for (double& t : shifted.pressure->t_s) t += 1e5;
  EXPECT_THAT([&] { (void)diagnose({shifted}, {"bench"}, model::nominal_model("slse1"), {}); },
              testing::ThrowsMessage<std::invalid_argument>(testing::AllOf(
                  testing::HasSubstr("bench: pressure.csv ("), testing::HasSubstr("have no time in common"))));
}

}  // namespace
}  // namespace isorig::identify
