#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/noise/repetitions.hpp"
#include "identify/diagnose/signal/noise_level.hpp"
#include "identify/diagnose/signal/spikes.hpp"
#include "model/composed.hpp"

namespace isorig::identify {
namespace {

struct Noise {
  double white_N = 0.0;
  double coloured_N = 0.0, coloured_s = 0.1;
  double step_N = 0.0;
  unsigned seed = 1;
};

/// 100 Hz, position known to 1 um; force: spring, dashpot, dry friction, and a drift of `drift_N_s`.
messages::Recording recording(const std::function<double(double)>& position_mm, double lasts_s, Noise noise,
                              double drift_N_s = 0.0) {
  std::mt19937 random(noise.seed);
  std::normal_distribution<double> normal;
  messages::Recording r;
  r.metadata.rest_length_mm = 100.0;
  const double dt_s = 0.01, decay = std::exp(-dt_s / noise.coloured_s);
  double slow = noise.coloured_N * normal(random), bristle = 0.0, before_mm = position_mm(0.0);
  for (double t = 0.0; t < lasts_s; t += dt_s) {
    const double x = position_mm(t), step = x - before_mm, sign = step > 0.0 ? 1.0 : -1.0;
    bristle = sign + (bristle - sign) * std::exp(-std::fabs(step) / 0.05);
    before_mm = x;
    slow = decay * slow + noise.coloured_N * std::sqrt(1.0 - decay * decay) * normal(random);
    double f = 0.4 * x + 0.05 * step / dt_s + 3.0 * bristle + drift_N_s * t + slow + noise.white_N * normal(random);
    if (noise.step_N > 0.0) f = noise.step_N * std::round(f / noise.step_N);
    r.frame.t_s.push_back(t);
    r.frame.position_mm.push_back(x + 1e-3 * normal(random));
    r.frame.force_N.push_back(f);
  }
  return r;
}

double triangle(double t) {
  const double phase = std::fmod(t, 8.0);
  return phase < 4.0 ? 10.0 * phase - 20.0 : 60.0 - 10.0 * phase;
}
double servo(double t) {
  return 30.0 * std::sin(2.0 * std::numbers::pi * 0.25 * t) + 4.0 * std::sin(2.0 * std::numbers::pi * 0.75 * t);
}
double swing(double t) {
  return 60.0 * std::exp(-t / 6.0) * std::cos(2.0 * std::numbers::pi * 0.4 * t);
}

InstrumentNoise measure(messages::Recording r) {
  std::vector<Series> series;
  series.push_back(prepare_series("r", std::move(r), {}));
  return instrument_noise(series, {});
}

/// A level from n readings errs by 1 / sqrt(2 n); strokes are used twice (against the one before and the one
/// after), which makes it 1 / sqrt(n), and correlation over m readings leaves n / m. Four of these.
double tolerance(double readings, double correlated = 1.0) {
  return 4.0 / std::sqrt(readings / correlated);
}

TEST(NoiseWithoutRests, WhiteIsMeasuredFromStrokesThatRepeat) {
  const auto noise = measure(recording(triangle, 80.0, {.white_N = 0.2}, 0.02));
  ASSERT_EQ(noise.source, NoiseSource::kRepetitions);
  EXPECT_NEAR(noise.noise.white_N, 0.2, 0.2 * tolerance(6000.0));
  EXPECT_EQ(noise.noise.coloured_N, 0.0);
}

TEST(NoiseWithoutRests, ACorrelatedPartCountsIntoTheLevel) {
  // Over 0.1 s at 100 Hz some 20 readings hang together in variance (1 + 2 sum of rho^2 = 10).
  const auto noise =
      measure(recording(triangle, 160.0, {.white_N = 0.1, .coloured_N = 0.3, .coloured_s = 0.1, .seed = 2}));
  ASSERT_EQ(noise.source, NoiseSource::kRepetitions);
  const double level = std::hypot(0.1, 0.3);
  EXPECT_NEAR(std::hypot(noise.noise.white_N, noise.noise.coloured_N), level, level * tolerance(12000.0, 10.0));
  // Second differences, which it falls back to without repetitions, see half of it.
  const auto r = recording(triangle, 160.0, {.white_N = 0.1, .coloured_N = 0.3, .coloured_s = 0.1, .seed = 2});
  EXPECT_LT(white_noise(r.frame.t_s, r.frame.force_N), 0.6 * level);
}

TEST(NoiseWithoutRests, CoarseStepsAreUniformNoise) {
  const auto noise = measure(recording(triangle, 80.0, {.white_N = 0.05, .step_N = 0.5, .seed = 3}));
  ASSERT_EQ(noise.source, NoiseSource::kRepetitions);
  // 0.5 N / sqrt(12) = 0.144 N with the noise beside it; rounding is not independent of what it rounds.
  const double level = std::hypot(0.05, 0.5 / std::sqrt(12.0));
  EXPECT_NEAR(noise.noise.white_N, level, 0.15 * level);
}

TEST(NoiseWithoutRests, ABandLimitedServoIsMeasuredPerReading) {
  const auto noise = measure(recording(servo, 80.0, {.white_N = 0.3, .seed = 4}));
  ASSERT_EQ(noise.source, NoiseSource::kRepetitions);
  EXPECT_NEAR(noise.weighing.white_N, 0.3, 0.3 * tolerance(8000.0 / 9.0));
}

TEST(NoiseWithoutRests, ASwingThatNeverComesBackIsMeasuredWithinItsStrokes) {
  const auto noise = measure(recording(swing, 25.0, {.white_N = 0.5, .seed = 5}));
  EXPECT_NE(noise.source, NoiseSource::kDifferences);
  EXPECT_NEAR(noise.weighing.white_N, 0.5, 0.5 * tolerance(2500.0 / 5.0));
}

TEST(NoiseWithoutRests, WhatRepeatsIsNotNoise) {
  // Ten times the noise, in no model, and the same in every stroke.
  auto r = recording(triangle, 80.0, {.white_N = 0.2, .seed = 6});
  for (std::size_t k = 0; k < r.frame.size(); ++k)
    r.frame.force_N[k] += 2.0 * std::sin(2.0 * std::numbers::pi * r.frame.position_mm[k] / 7.0);
  const auto noise = measure(std::move(r));
  ASSERT_EQ(noise.source, NoiseSource::kRepetitions);
  EXPECT_NEAR(noise.noise.white_N, 0.2, 0.2 * tolerance(6000.0));
}

TEST(NoiseWithoutRests, RestsComeFirst) {
  EXPECT_EQ(measure(test::record({})).source, NoiseSource::kRests);
}

/// An axis that never rests, with spring and dashpot in the model and dry friction not, its noise correlated.
TEST(NoiseWithoutRests, DryFrictionIsNamedWithCertainty) {
  const auto nominal = model::parse_model(R"(format = "isorig-model/1"
name = "axis"
[[part]]
physics = "spring"
[[part]]
physics = "dashpot"
[[part]]
physics = "constant"
)",
                                          "axis");
  const auto r = recording(servo, 80.0, {.white_N = 0.1, .coloured_N = 0.3, .coloured_s = 0.1, .seed = 7});
  const Diagnosis d = diagnose({r}, {"axis"}, nominal, {}).diagnosis;
  EXPECT_EQ(d.noise_source, NoiseSource::kRepetitions);
  EXPECT_EQ(d.verdict, Verdict::kMissingPhysics);
  ASSERT_FALSE(d.missing.empty());
  EXPECT_EQ(d.missing[0].effect->name, "coulomb_friction");
  EXPECT_GT(d.missing[0].probability, 0.9);
}

/// A laser that loses its target for one reading in a hundred: each would turn friction round.
TEST(Spikes, OfThePositionDoNotTurnTheMotionBack) {
  auto r = recording(triangle, 80.0, {.white_N = 0.1, .seed = 8});
  const auto clean = r.frame.position_mm;
  std::mt19937 random(9);
  std::vector<std::size_t> spoilt;
  for (std::size_t k = 50; k + 50 < clean.size(); k += 60 + random() % 80) {
    r.frame.position_mm[k] += (random() % 2 == 0 ? 1.0 : -1.0) * (0.2 + 0.001 * static_cast<double>(random() % 400));
    spoilt.push_back(k);
  }
  const Despiked out = without_spikes(r.frame.t_s, r.frame.position_mm, recording_quality(r).position);
  EXPECT_EQ(out.spikes.rows, spoilt);
  for (std::size_t k = 0; k < clean.size(); ++k) EXPECT_NEAR(out.reading_mm[k], clean[k], 0.01);
  const Guarded guarded = guard_recording(r);
  ASSERT_EQ(guarded.faults.size(), 1u);
  EXPECT_EQ(guarded.faults[0].kind, "outliers");
  EXPECT_EQ(guarded.faults[0].rows, spoilt.size());
  const Series series = prepare_series("r", r, guarded.usable);
  EXPECT_EQ(stroke_count(series), 20u);
}

TEST(Spikes, AreNotSeenWhereTheMotionTurns) {
  const auto r = recording(triangle, 80.0, {.white_N = 0.1, .seed = 10});
  EXPECT_TRUE(without_spikes(r.frame.t_s, r.frame.position_mm, recording_quality(r).position).spikes.rows.empty());
  const auto bench = test::record_other({});
  EXPECT_TRUE(
      without_spikes(bench.frame.t_s, bench.frame.position_mm, recording_quality(bench).position).spikes.rows.empty());
}

}  // namespace
}  // namespace isorig::identify
