#include "identify/fv/ramps.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "iso_velocity_recording.hpp"

namespace isorig::identify {
namespace {

using testing::IsoVelocityTest;
using testing::Truth;

/// Every ramp of the protocol, nothing else, with numbers that their own standard errors cover.
void expect_protocol_found(const IsoVelocityTest& test, double velocity_relative) {
  std::vector<Truth> truth;
  const auto recording = testing::simulate(test, &truth);
  const RampAnalysis found = analyse_ramps(recording);
  ASSERT_EQ(found.ramps.size(), truth.size());
  const auto returns =
      std::count_if(found.moves.begin(), found.moves.end(), [](const Move& m) { return m.kind == MoveKind::kReturn; });
  EXPECT_EQ(static_cast<std::size_t>(returns), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Ramp& r = found.ramps[i];
    const double v = truth[i].velocity_mm_s;
    SCOPED_TRACE(::testing::Message() << "ramp " << i << " at " << v << " mm/s");
    EXPECT_NEAR(r.move.velocity_mm_s.value, v,
                velocity_relative * std::abs(v) + 5 * r.move.velocity_mm_s.standard_error);
    ASSERT_TRUE(r.start_force_N && r.peak_force_N && r.normalized_force && r.drift_N_s);
    // 5 standard errors of 20 ramps are exceeded by chance once in 100 000 runs; the stated error itself must
    // be of the size that the noise implies (next line), or this would be empty.
    EXPECT_NEAR(r.start_force_N->value, truth[i].force_before_N, 5 * r.start_force_N->standard_error);
    EXPECT_LT(r.start_force_N->standard_error, test.force_noise_N);
    // The line's bend over 15 % of the stroke (0.0007 of the viscous height), and the margin of arrival.
    const double viscous_N = std::abs(truth[i].force_at_arrival_N - truth[i].force_before_N);
    EXPECT_NEAR(r.peak_force_N->value, truth[i].force_at_arrival_N,
                5 * r.peak_force_N->standard_error + 0.002 * viscous_N);
    EXPECT_LT(r.peak_force_N->standard_error, 2.5 * test.force_noise_N + 1e-9);
    EXPECT_NEAR(*r.strain_step, std::copysign(test.stroke_mm, v) / test.pressurized_length_mm, 1e-4);
    EXPECT_NEAR(*r.initial_strain, test.rest_length_mm / test.pressurized_length_mm - 1.0, 1e-4);
    EXPECT_FALSE(r.has(RampFlag::kUnsteadyStart));
  }
}

TEST(Ramps, PaperProtocolWithIdealCrosshead) {
  expect_protocol_found({}, 1e-3);
}

TEST(Ramps, SaysThatSamplesAreTooFarApart) {
  auto recording = testing::simulate({}, nullptr);
  messages::Recording sparse;
  sparse.metadata = recording.metadata;
  double next_s = 0.0;
  for (std::size_t i = 0; i < recording.frame.size(); ++i) {
    if (recording.frame.t_s[i] < next_s) continue;
    next_s = recording.frame.t_s[i] + 1.0;  // of samples 0.2 s apart, or nearly: 1.1 s
    // Nothing of the protocol's rests is left either: strokes all the time, at one sample a second.
    const double phase = 1.9 * static_cast<double>(sparse.frame.size());
    sparse.frame.t_s.push_back(recording.frame.t_s[i]);
    sparse.frame.position_mm.push_back(2.0 * std::sin(phase));
    sparse.frame.force_N.push_back(std::sin(phase));
  }
  const auto found = analyse_ramps(sparse);
  EXPECT_TRUE(found.moves.empty());
  EXPECT_THAT(found.statements, ::testing::Contains(::testing::HasSubstr("the samples are 1.1 s apart")));
  for (auto& x : sparse.frame.position_mm) x *= 1e-4;  // at rest, in noise
  EXPECT_THAT(analyse_ramps(sparse).statements, ::testing::Contains(::testing::HasSubstr("Nothing moves")));
}

/// At 100 and 50 Hz a fast ramp has 20 and 10 samples, of which the last 15 % of the stroke hold three and one or two.
/// The first sample behind the target has relaxed already.
TEST(Ramps, FewSamplesGiveAForceAtTheTargetThatTheirErrorCovers) {
  for (const double step_s : {0.01, 0.02}) {
    double sum = 0.0, squares = 0.0;
    int count = 0;
    for (unsigned seed = 1; seed <= 8; ++seed) {
      std::vector<Truth> truth;
      const auto recording = testing::simulate({.force_noise_N = 0.002, .dense_step_s = step_s, .seed = seed}, &truth);
      const RampAnalysis found = analyse_ramps(recording);
      ASSERT_EQ(found.ramps.size(), truth.size());
      for (std::size_t i = 0; i < truth.size(); ++i) {
        const Ramp& r = found.ramps[i];
        if (!r.peak_force_N) continue;
        const double viscous_N = std::abs(truth[i].force_at_arrival_N - truth[i].force_before_N);
        const double off_N = r.peak_force_N->value - truth[i].force_at_arrival_N;
        EXPECT_LT(std::abs(off_N), 0.005 * viscous_N + 5.0 * r.peak_force_N->standard_error) << step_s << ' ' << i;
        // The line over the last 15 % of slower ramps is off by 0.0007 of the viscous height without saying so.
        const double z = off_N / std::hypot(r.peak_force_N->standard_error, 0.0007 * viscous_N);
        sum += z;
        squares += z * z;
        ++count;
      }
    }
    ASSERT_GE(count, 64) << step_s << ": a ramp of ten samples is measured";
    // Eighty independent numbers of unit variance: 1 +- 0.08 rms. Their own errors are conservative by the cubic term.
    EXPECT_LT(std::sqrt(squares / count), 1.4) << step_s;
    EXPECT_LT(std::abs(sum / count), 0.6) << step_s;
  }
}

TEST(Ramps, SlowRampsAndMillimetreStrokes) {
  IsoVelocityTest test;
  test.speeds_mm_s = {0.05, 0.2, 1.0};
  expect_protocol_found(test, 1e-3);
  test.stroke_mm = 1.0;  // as the paper does at 5 psi
  test.precondition = false;
  expect_protocol_found(test, 1e-3);
}

TEST(Ramps, NoisyPosition) {
  IsoVelocityTest test;
  test.position_noise_mm = 0.01;
  test.seed = 7;
  std::vector<Truth> truth;
  const RampAnalysis found = analyse_ramps(testing::simulate(test, &truth));
  ASSERT_EQ(found.ramps.size(), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Ramp& r = found.ramps[i];
    EXPECT_NEAR(r.move.velocity_mm_s.value, truth[i].velocity_mm_s,
                5 * r.move.velocity_mm_s.standard_error + 1e-3 * std::abs(truth[i].velocity_mm_s));
    ASSERT_TRUE(r.peak_force_N);
    // 3 sigma of position (the margin of arrival) times the stiffness of the ramp, beside the force noise.
    EXPECT_NEAR(r.peak_force_N->value, truth[i].force_at_arrival_N,
                5 * r.peak_force_N->standard_error + 3 * 0.01 * (360.0 / 79.0));
  }
}

TEST(Ramps, PositionNoiseOfOnePerCentOfTheStroke) {
  IsoVelocityTest test;
  test.position_noise_mm = 0.02;
  test.stroke_mm = 2.0;
  std::vector<Truth> truth;
  const RampAnalysis found = analyse_ramps(testing::simulate(test, &truth));
  EXPECT_EQ(found.ramps.size(), truth.size());
}

TEST(Ramps, OvershootIsMeasuredAndThePeakIsTakenBeforeIt) {
  IsoVelocityTest test;
  test.bandwidth_per_s = 120.0;
  test.damping = 0.5;
  std::vector<Truth> truth;
  const auto recording = testing::simulate(test, &truth);
  const RampAnalysis found = analyse_ramps(recording);
  ASSERT_EQ(found.ramps.size(), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Ramp& r = found.ramps[i];
    const double speed = std::abs(truth[i].velocity_mm_s);
    SCOPED_TRACE(::testing::Message() << truth[i].velocity_mm_s << " mm/s");
    const double goal = std::copysign(2.0, truth[i].velocity_mm_s);
    double highest = 0.0;
    for (std::size_t k = 0; k < recording.frame.size(); ++k)
      if (std::abs(recording.frame.t_s[k] - truth[i].t_arrival_s) < 1.0)
        highest = std::max(highest, (recording.frame.position_mm[k] - goal) * (goal > 0 ? 1 : -1));
    // The same samples; the target itself is a median of some 500 with 0.5 um noise.
    EXPECT_NEAR(r.overshoot_mm, highest, 5 * 0.0005 * 1.25 / std::sqrt(150.0));
    if (std::abs(highest - 0.01) > 0.001) {
      EXPECT_EQ(r.has(RampFlag::kOvershot), highest > 0.01) << highest;
    }
    ASSERT_TRUE(r.t_peak_s && r.peak_force_N);
    EXPECT_NEAR(*r.t_peak_s, truth[i].t_arrival_s, 0.003);
    EXPECT_NEAR(r.peak_force_N->value, truth[i].force_at_arrival_N, 5 * r.peak_force_N->standard_error + 0.02);
    EXPECT_NEAR(std::abs(r.move.velocity_mm_s.value), speed, 0.03 * speed);
  }
}

TEST(Ramps, CreepIntoTheTargetIsAnArrival) {
  IsoVelocityTest test;
  test.bandwidth_per_s = 100.0;
  test.damping = 1.5;
  test.arrival_margin_mm = 0.002;  // the end of an exponential creep is nowhere: 0.1 % of the stroke
  std::vector<Truth> truth;
  const RampAnalysis found = analyse_ramps(testing::simulate(test, &truth));
  ASSERT_EQ(found.ramps.size(), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    ASSERT_TRUE(found.ramps[i].peak_force_N) << truth[i].velocity_mm_s;
    EXPECT_FALSE(found.ramps[i].has(RampFlag::kOvershot));
    EXPECT_NEAR(*found.ramps[i].t_peak_s, truth[i].t_arrival_s, 0.01);
    // The line of force against position ends at the creep's bend: off by what the arm (tau 0.25 s) lost in
    // it.
    EXPECT_NEAR(found.ramps[i].peak_force_N->value, truth[i].force_at_arrival_N, 0.1 * 4.0);
  }
}

TEST(Ramps, NeverReachedItsSpeed) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 20};
  test.acceleration_limit_mm_s2 = 20.0;  // 2 mm in 0.63 s up and down again: the top is 6.3 mm/s
  std::vector<Truth> truth;
  const RampAnalysis found = analyse_ramps(testing::simulate(test, &truth));
  ASSERT_EQ(found.ramps.size(), 4U);
  for (std::size_t i : {0U, 1U})
    EXPECT_FALSE(found.ramps[i].has(RampFlag::kNeverReachedSpeed)) << found.ramps[i].plateau_share;
  for (std::size_t i : {2U, 3U}) {
    EXPECT_TRUE(found.ramps[i].has(RampFlag::kNeverReachedSpeed)) << found.ramps[i].plateau_share;
    EXPECT_FALSE(found.ramps[i].usable());
  }
}

TEST(Ramps, DriftOfTheStartingForceIsStatedWithItsError) {
  IsoVelocityTest test;
  test.force_drift_N_s = 0.15;
  test.speeds_mm_s = {2, 4};
  test.precondition = false;
  std::vector<Truth> truth;
  const RampAnalysis found = analyse_ramps(testing::simulate(test, &truth));
  ASSERT_EQ(found.ramps.size(), truth.size());
  for (const Ramp& r : found.ramps) {
    ASSERT_TRUE(r.drift_N_s);
    EXPECT_NEAR(r.drift_N_s->value, 0.15, 5 * r.drift_N_s->standard_error);
    EXPECT_LT(r.drift_N_s->standard_error, 0.02);
    EXPECT_TRUE(r.has(RampFlag::kUnsteadyStart));
  }
}

/// A ramp that is paused half-way is two strokes between holds; neither is a point of the curve.
TEST(Ramps, APausedRampIsNotTwo) {
  IsoVelocityTest test;
  test.precondition = false;
  std::vector<Truth> truth;
  auto recording = testing::simulate(test, &truth);
  const double paused_s = truth[4].t_start_s + 0.1, resumed_s = paused_s + 5.0;
  for (const auto& [text, unused] :
       {std::pair{"events = 3", 0U}, std::pair{"[[events]]\ncode = 'session.start'\nt_s = 0.0\n", 0U},
        std::pair{"[[events]]\ncode = 'pause'\nt_s = PAUSED\n[[events]]\ncode = 'resume'\nt_s = RESUMED\n", 1U}}) {
    std::string toml = text;
    for (const auto& [word, at_s] : {std::pair{"PAUSED", paused_s}, std::pair{"RESUMED", resumed_s}})
      if (const auto at = toml.find(word); at != std::string::npos)
        toml.replace(at, std::string(word).size(), std::to_string(at_s));
    recording.metadata.further_toml = toml;
    const RampAnalysis found = analyse_ramps(recording);
    ASSERT_EQ(found.ramps.size(), truth.size());
    const auto usable = std::ranges::count_if(found.ramps, [](const Ramp& r) { return r.usable(); });
    EXPECT_EQ(static_cast<std::size_t>(usable), truth.size() - unused) << toml;
    EXPECT_EQ(found.ramps[4].has(RampFlag::kInterrupted), unused == 1U) << toml;
  }
}

TEST(Ramps, ClippedForceGivesNoPeak) {
  IsoVelocityTest test;
  std::vector<Truth> truth;
  auto recording = testing::simulate(test, &truth);
  double highest = 0.0;
  for (const Truth& t : truth) highest = std::max(highest, t.force_at_arrival_N);
  const double limit_N = highest - 1.0;
  for (double& f : recording.frame.force_N) f = std::min(f, limit_N);
  const RampAnalysis found = analyse_ramps(recording);
  EXPECT_GT(found.clipped_samples, 0U);
  EXPECT_FALSE(found.statements.empty());
  std::size_t clipped = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const bool beyond = truth[i].force_at_arrival_N > limit_N + 0.3;
    if (beyond) {
      EXPECT_TRUE(found.ramps[i].has(RampFlag::kForceClipped));
      EXPECT_FALSE(found.ramps[i].normalized_force);
      ++clipped;
    } else if (truth[i].velocity_mm_s < 0) {
      EXPECT_TRUE(found.ramps[i].normalized_force);
    }
  }
  EXPECT_GE(clipped, 3U);
}

TEST(Ramps, TrianglesAndSinesAreCyclesNotRamps) {
  messages::Recording recording;
  recording.metadata.rest_length_mm = 90;
  recording.metadata.pressurized_rest_length_mm = 80;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 5e-4);
  for (double t = 0; t < 60; t += 0.005) {
    double x = 0;
    if (t > 10 && t < 20) x = 2.0 * std::asin(std::sin(2 * std::numbers::pi * 0.5 * (t - 10)));
    if (t > 30 && t < 50) x = 2.0 * std::sin(2 * std::numbers::pi * 0.5 * (t - 30));
    recording.frame.t_s.push_back(t);
    recording.frame.position_mm.push_back(x + noise(random));
    recording.frame.force_N.push_back(30 + 4 * x + 20 * noise(random));
  }
  const RampAnalysis found = analyse_ramps(recording);
  EXPECT_TRUE(found.ramps.empty());
  EXPECT_EQ(found.moves.size(), 11U + 21U);
  for (const Move& m : found.moves) EXPECT_EQ(m.kind, MoveKind::kCycle);
  ASSERT_FALSE(found.statements.empty());
  EXPECT_THAT(found.statements.front(), ::testing::HasSubstr("no iso-velocity ramp"));
}

TEST(Ramps, RestHasNoMotionWhateverItsNoise) {
  for (double correlation : {0.0, 0.9}) {
    messages::Recording recording;
    recording.metadata.rest_length_mm = 90;
    std::mt19937 random(5);
    std::normal_distribution<double> noise(0.0, 0.01);
    double x = 0;
    for (double t = 0; t < 100; t += 0.01) {
      x = correlation * x + std::sqrt(1 - correlation * correlation) * noise(random);
      recording.frame.t_s.push_back(t);
      recording.frame.position_mm.push_back(x);
      recording.frame.force_N.push_back(30 + noise(random));
    }
    const RampAnalysis found = analyse_ramps(recording);
    EXPECT_TRUE(found.moves.empty()) << "correlation " << correlation;
    ASSERT_FALSE(found.statements.empty());
    EXPECT_THAT(found.statements.front(), ::testing::HasSubstr("Nothing moves"));
  }
}

TEST(Ramps, StartingForceOfZeroIsNotDividedBy) {
  IsoVelocityTest test;
  test.pressurized_length_mm = test.rest_length_mm;  // no tension at the start
  const RampAnalysis found = analyse_ramps(testing::simulate(test));
  ASSERT_EQ(found.ramps.size(), 10U);
  for (const Ramp& r : found.ramps) {
    EXPECT_FALSE(r.normalized_force);
    EXPECT_TRUE(r.has(RampFlag::kForceNotPositive));
    EXPECT_TRUE(r.peak_force_N);
  }
}

TEST(Ramps, ASpecimenThatGoesSlackIsFlagged) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 10};
  test.pressurized_length_mm = 90.0;  // 1 mm of tension, 2 mm of shortening
  auto recording = testing::simulate(test);
  for (double& f : recording.frame.force_N) f = std::max(f, 0.0);
  const RampAnalysis found = analyse_ramps(recording);
  ASSERT_EQ(found.ramps.size(), 4U);
  for (const Ramp& r : found.ramps) {
    if (r.has(RampFlag::kForceClipped)) continue;  // exact zeros are a saturated channel as well
    EXPECT_EQ(r.has(RampFlag::kWentSlack), r.move.velocity_mm_s.value < 0.0);
  }
  // With noise on the zero it is no saturation.
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0.0, 0.02);
  for (double& f : recording.frame.force_N) f += noise(random);
  const RampAnalysis noisy = analyse_ramps(recording);
  ASSERT_EQ(noisy.ramps.size(), 4U);
  for (const Ramp& r : noisy.ramps) EXPECT_EQ(r.has(RampFlag::kWentSlack), r.move.velocity_mm_s.value < 0.0);
}

TEST(Ramps, OneRampIsOneRamp) {
  IsoVelocityTest test;
  test.speeds_mm_s = {5};
  test.precondition = false;
  auto recording = testing::simulate(test);
  // Cut after the hold of the first ramp.
  const auto cut = static_cast<std::size_t>(
      std::lower_bound(recording.frame.t_s.begin(), recording.frame.t_s.end(), 65.0) - recording.frame.t_s.begin());
  recording.frame.t_s.resize(cut);
  recording.frame.position_mm.resize(cut);
  recording.frame.force_N.resize(cut);
  EXPECT_EQ(analyse_ramps(recording).ramps.size(), 1U);
}

TEST(Ramps, TooSparseARampHasNoVelocity) {
  IsoVelocityTest test;
  test.speeds_mm_s = {10};
  test.dense_step_s = 0.2;
  const RampAnalysis found = analyse_ramps(testing::simulate(test));
  ASSERT_EQ(found.ramps.size(), 2U);
  for (const Ramp& r : found.ramps) {
    EXPECT_TRUE(r.has(RampFlag::kTooFewSamples));
    EXPECT_FALSE(r.usable());
    EXPECT_TRUE(std::isnan(r.move.velocity_mm_s.value));
  }
}

/// A measurement by others: its own column names and metres.
messages::Recording foreign(const std::filesystem::path& file, const char* position, const char* force) {
  std::ifstream in(file);
  std::string line, cell;
  std::getline(in, line);
  std::vector<std::string> header;
  for (std::istringstream row(line); std::getline(row, cell, ',');) header.push_back(cell);
  const auto column = [&](const char* name) { return std::find(header.begin(), header.end(), name) - header.begin(); };
  messages::Recording out;
  out.metadata.rest_length_mm = 80.0;
  while (std::getline(in, line)) {
    std::vector<double> values;
    for (std::istringstream row(line); std::getline(row, cell, ',');) values.push_back(std::stod(cell));
    out.frame.t_s.push_back(values.at(static_cast<std::size_t>(column("time_s"))));
    out.frame.position_mm.push_back(1000.0 * values.at(static_cast<std::size_t>(column(position))));
    out.frame.force_N.push_back(values.at(static_cast<std::size_t>(column(force))));
  }
  return out;
}

/// The folder that an environment variable names; none: "".
std::filesystem::path told_by(const char* variable) {
  const char* folder = std::getenv(variable);
  return folder == nullptr ? "" : folder;
}

TEST(Ramps, MeasurementsByOthersGiveTheSpeedsTheyWereMadeAt) {
  const auto root = told_by("ISORIG_RECORDINGS");
  if (root.empty())
    GTEST_SKIP() << "the measurements of others are not in this tree, their licences are not all stated: set "
                    "ISORIG_RECORDINGS to the folder that `isorig-proof real` reads (docs/proof.md)";
  // Load and unload without a hold: legs of a cycle, at 0.01, 0.03 and 0.05 of 80 mm a second.
  for (const auto& [name, speed] : {std::pair{"cycle_rate0.01_stretch3.0.csv", 0.8},
                                    {"cycle_rate0.03_stretch1.5.csv", 2.4},
                                    {"cycle_rate0.05_stretch2.0.csv", 4.0}}) {
    const auto found = analyse_ramps(foreign(root / "vhb4910-tape" / name, "displacement_m", "force_N"));
    ASSERT_EQ(found.moves.size(), 2U) << name;
    EXPECT_TRUE(found.ramps.empty());
    EXPECT_NEAR(found.moves[0].velocity_mm_s.value, speed, 1e-3 * speed);
    EXPECT_NEAR(found.moves[1].velocity_mm_s.value, -speed, 1e-3 * speed);
  }
  // A ramp that begins with the record, then a hold of half an hour: velocity and peak, but no F0 to divide
  // by.
  const auto relaxation =
      analyse_ramps(foreign(root / "vhb4910-tape/relax_stretch3.0.csv", "displacement_m", "force_N"));
  ASSERT_EQ(relaxation.ramps.size(), 1U);
  EXPECT_NEAR(relaxation.ramps[0].move.velocity_mm_s.value, 20.0, 0.02);
  EXPECT_TRUE(relaxation.ramps[0].peak_force_N);
  EXPECT_TRUE(relaxation.ramps[0].has(RampFlag::kNoRestBefore));
  EXPECT_FALSE(relaxation.ramps[0].normalized_force);
  // Pulled to failure: one stroke, no rest and no hold.
  const auto pulled = analyse_ramps(foreign(root / "elastomer-tensile/dragon_skin_30.csv", "extension_m", "force_N"));
  ASSERT_EQ(pulled.ramps.size(), 1U);
  EXPECT_NEAR(pulled.ramps[0].move.velocity_mm_s.value, 7.5, 1e-3);
  EXPECT_TRUE(pulled.ramps[0].has(RampFlag::kNoHoldAfter));
  EXPECT_FALSE(pulled.ramps[0].peak_force_N);
}

/// Recordings of a simulated rig that shares no code with this one, by the paper's protocol.
TEST(Ramps, FindsTheTenRampsOfEveryIndependentRecording) {
  const auto root = told_by("ISORIG_INDEPENDENT_CASES");
  if (root.empty())
    GTEST_SKIP() << "recordings of a rig that shares no code with this one are not in this tree: set "
                    "ISORIG_INDEPENDENT_CASES to a folder of CASE/train, by the paper's protocol (docs/proof.md)";
  const double speeds[] = {2, -2, 4, -4, 6, -6, 8, -8, 10, -10};
  for (const auto& folder : std::filesystem::directory_iterator(root)) {
    const RampAnalysis found = analyse_ramps(messages::read_recording(folder.path() / "train"));
    ASSERT_EQ(found.ramps.size(), 10U) << folder.path();
    for (std::size_t i = 0; i < 10; ++i) {
      EXPECT_NEAR(found.ramps[i].move.velocity_mm_s.value, speeds[i], 0.02 * std::abs(speeds[i])) << folder.path();
      EXPECT_TRUE(found.ramps[i].peak_force_N) << folder.path() << " ramp " << i;
    }
  }
}

}  // namespace
}  // namespace isorig::identify
