// The noise of the force channel as the rests of a recording show it.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/noise_search.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "identify/diagnose/noise/noise_likelihood.hpp"

namespace isorig::identify {
namespace {

InstrumentNoise noise_of(const test::ConcealedSpecimen& bench) {
  const std::vector<Series> series{prepare_series("bench", test::record(bench), {})};
  return instrument_noise(series, {});
}

/// The bench rests for some 300 s after its first 10 s of settling, at 5 Hz: 1500 readings know a white noise
/// to 1 / sqrt(2 x 1500) = 2 %; three of that.
TEST(NoiseFromRests, WhiteIsRecovered) {
  for (const double white_N : {0.002, 0.02, 0.1}) {
    const InstrumentNoise found = noise_of({.force_noise_N = white_N, .force_step_N = 1e-4, .seed = 11});
    EXPECT_EQ(found.source, NoiseSource::kRests);
    EXPECT_NEAR(found.noise.white_N, white_N, 0.06 * white_N);
    EXPECT_LT(found.noise.coloured_N, 0.3 * white_N);
  }
}

/// A noise of 2 s is independent some 80 times in those rests, less two numbers of each rest: 1 / sqrt(2 x
/// 60) = 9 % of its size, three of that; its white companion is known nearly as well as alone.
TEST(NoiseFromRests, ColouredIsToldFromWhite) {
  for (const double coloured_N : {0.03, 0.06}) {
    const InstrumentNoise found = noise_of({.coloured_N = coloured_N, .coloured_s = 2.0, .seed = 12});
    EXPECT_NEAR(found.noise.white_N, 0.02, 0.1 * 0.02);
    EXPECT_NEAR(found.noise.coloured_N, coloured_N, 0.3 * coloured_N);
    EXPECT_GT(found.noise.correlation_s, 0.7);
    EXPECT_LT(found.noise.correlation_s, 6.0);
  }
}

/// Every third reading alone in every second minute, as of a logger that changes its rate.
messages::Recording at_two_rates(const messages::Recording& recording) {
  messages::Recording out = recording;
  out.frame = {};
  for (std::size_t k = 0; k < recording.frame.size(); ++k) {
    if (std::fmod(recording.frame.t_s[k], 120.0) > 60.0 && k % 3 != 0) continue;
    out.frame.t_s.push_back(recording.frame.t_s[k]);
    out.frame.position_mm.push_back(recording.frame.position_mm[k]);
    out.frame.force_N.push_back(recording.frame.force_N[k]);
  }
  return out;
}

/// Noise behind a filter that takes a step for each reading: it forgets by readings.
messages::Recording filtered_by_readings(messages::Recording recording, double coloured_N, double readings,
                                         unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const double kept = std::exp(-1.0 / readings);
  double state = normal(random);
  for (double& force_N : recording.frame.force_N) {
    force_N += coloured_N * state;
    state = kept * state + std::sqrt(1.0 - kept * kept) * normal(random);
  }
  return recording;
}

/// Some 1000 readings, 8 of which know as much as 1: 1 / sqrt(2 x 125 - 2 x 11) = 7 % of its size, three of that, and a
/// factor of two for the correlation, which is known half as well as in ColouredIsToldFromWhite's time.
TEST(NoiseFromRests, ANoiseThatForgetsByReadingsIsToldFromOneThatForgetsByTime) {
  for (unsigned seed = 41; seed < 45; ++seed) {
    SCOPED_TRACE(seed);
    const auto recording = at_two_rates(test::record({.force_step_N = 1e-4, .seed = seed}));
    const auto filtered = filtered_by_readings(recording, 0.03, 8.0, seed);
    const InstrumentNoise found = instrument_noise(std::vector<Series>{prepare_series("bench", filtered, {})}, {});
    ASSERT_NEAR(found.reading_s, 0.2, 0.02);
    EXPECT_NEAR(found.noise.coloured_N, 0.03, 0.3 * 0.03);
    EXPECT_NEAR(found.noise.white_N, 0.02, 0.1 * 0.02);
    EXPECT_GT(found.noise.correlation_s / found.reading_s, 4.0);
    EXPECT_LT(found.noise.correlation_s / found.reading_s, 16.0);

    const auto in_time =
        at_two_rates(test::record({.coloured_N = 0.03, .coloured_s = 1.6, .force_step_N = 1e-4, .seed = seed}));
    EXPECT_EQ(instrument_noise(std::vector<Series>{prepare_series("bench", in_time, {})}, {}).reading_s, 0.0);
    // Read evenly the two are one, and time is what people ask for.
    const auto even =
        filtered_by_readings(test::seldom_read_at_rest(test::record({.seed = seed}), 0.15), 0.03, 8.0, seed);
    EXPECT_EQ(instrument_noise(std::vector<Series>{prepare_series("bench", even, {})}, {}).reading_s, 0.0);
  }
  EXPECT_EQ(correlation_words(1.6, 0.2), "8 readings");
  EXPECT_EQ(correlation_words(8.0, 0.005), "1600 readings");
  EXPECT_EQ(correlation_words(1.6, 0.0), "1.6 s");
}

TEST(NoiseFromRests, CountsTheStepOfACoarseReading) {
  const double step_N = 0.1;
  const InstrumentNoise found = noise_of({.force_noise_N = 0.005, .force_step_N = step_N, .seed = 13});
  EXPECT_GE(std::hypot(found.noise.white_N, found.noise.coloured_N), 0.4 * step_N / std::sqrt(12.0));
  EXPECT_LE(found.noise.white_N, 1.5 * step_N / std::sqrt(12.0));
}

/// Relaxation, friction, drift, softening and a wandering pressure are no noise, whatever the model knows of
/// them.
TEST(NoiseFromRests, TakesNoPhysicsForNoise) {
  for (const test::ConcealedSpecimen& bench :
       {test::ConcealedSpecimen{.second_arm_N_mm = 0.6, .second_arm_s = 9.0},
        test::ConcealedSpecimen{.friction_N = 0.8}, test::ConcealedSpecimen{.power = 1.8},
        test::ConcealedSpecimen{.softening_N_mm = 0.05}, test::ConcealedSpecimen{.drift_N_h = 3.0},
        test::ConcealedSpecimen{.ripple_N = 0.3}, test::ConcealedSpecimen{.gap_mm = 0.08}}) {
    const InstrumentNoise found = noise_of(bench);
    EXPECT_EQ(found.source, NoiseSource::kRests);
    EXPECT_NEAR(found.noise.white_N, 0.02, 0.06 * 0.02);
    EXPECT_LT(found.noise.coloured_N, 0.008);
  }
}

RestsOnNoise rests_of(const messages::Recording& recording, const NoiseModel& noise) {
  const std::vector<Series> series{prepare_series("bench", recording, {})};
  return rests_on(noise, series, {});
}

/// Twice the log-likelihood that the truth loses is distributed as chi-square with three degrees: above 7.8 in one of
/// twenty (six of seeds 20 to 119). More than three of twenty would be chance in 2 of 100.
TEST(NoiseFromRests, AllowTheNoiseThatTheyHave) {
  int refused = 0;
  for (unsigned seed = 20; seed < 40; ++seed) {
    const test::ConcealedSpecimen bench{
        .force_noise_N = 0.02, .coloured_N = 0.01, .coloured_s = 0.5, .force_step_N = 1e-4, .seed = seed};
    refused += rests_of(test::record(bench), {.white_N = 0.02, .coloured_N = 0.01, .correlation_s = 0.5}).allow ? 0 : 1;
  }
  EXPECT_LE(refused, 3);
}

/// 2250 readings of white noise.
TEST(NoiseFromRests, RuleOutWhatTheyWouldShow) {
  const messages::Recording recording = test::record({.force_noise_N = 0.02, .force_step_N = 1e-4, .seed = 11});
  const RestsOnNoise white = rests_of(recording, {.white_N = 0.02});
  EXPECT_TRUE(white.allow);
  EXPECT_NEAR(static_cast<double>(white.readings), 2250.0, 10.0);
  EXPECT_FALSE(rests_of(recording, {.white_N = 0.023}).allow) << "fifteen per cent, of which 1.5 are one deviation";
  EXPECT_TRUE(rests_of(recording, {.white_N = 0.02, .coloured_N = 0.003, .correlation_s = 0.5}).allow);
  EXPECT_FALSE(rests_of(recording, {.white_N = 0.02, .coloured_N = 0.01, .correlation_s = 0.5}).allow);
  EXPECT_FALSE(rests_of(recording, {.white_N = 0.02, .coloured_N = 0.003, .correlation_s = 60.0}).allow)
      << "longer than a rest";
}

/// White and coloured noise of the same sum. Readings at 5 Hz would be correlated by r = 0.13, and n of them lose n r^2
/// / 2 of their log-likelihood: 18 of 2250. Those of every 0.6 s would be correlated by 0.03: 0.2 of 385.
TEST(NoiseFromRests, RuleOutLessWhereTheyAreReadSeldom) {
  const NoiseModel mixed{.white_N = 0.0173, .coloured_N = 0.01, .correlation_s = 0.3};
  const messages::Recording recording = test::record({.force_noise_N = 0.02, .force_step_N = 1e-4, .seed = 11});
  EXPECT_FALSE(rests_of(recording, mixed).allow);
  EXPECT_TRUE(rests_of(test::seldom_read_at_rest(recording, 0.5), mixed).allow);
}

TEST(NoiseFromRests, LeavesOutWhatTheGuardLeftOut) {
  const test::ConcealedSpecimen bench{.seed = 14};
  messages::Recording recording = test::record(bench);
  std::vector<bool> usable(recording.frame.size(), true);
  for (std::size_t k = 7; k < recording.frame.size(); k += 53) {
    recording.frame.force_N[k] += k % 2 == 0 ? 2.0 : -2.0;
    usable[k] = false;
  }
  const std::vector<std::vector<bool>> all{usable};
  const std::vector<Series> series{prepare_series("bench", std::move(recording), usable)};
  EXPECT_NEAR(instrument_noise(series, all).noise.white_N, bench.force_noise_N, 0.06 * bench.force_noise_N);
}

// 0.1 N over 5 s has the steps of 0.45 N over 100 s, and neither number alone can be moved from the second to the
// first. 600 s are 60 times 2 * 5 s: the correlation is known to 1.7 times, three standard deviations.
TEST(NoiseSearch, FollowsTheRidgeOfAmplitudeAndCorrelation) {
  std::mt19937_64 random(17);
  std::normal_distribution<double> normal;
  const NoiseModel truth{0.33, 0.1, 5.0};
  constexpr double kStep_s = 0.25, kReadings = 120.0;
  NoiseSample sample;
  double state_N = truth.coloured_N * normal(random);
  for (int k = 0; k < 2400; ++k) {
    const double keep = std::exp(-kStep_s / truth.correlation_s);
    state_N = keep * state_N + truth.coloured_N * std::sqrt(1.0 - keep * keep) * normal(random);
    sample.t_s.push_back(k * kStep_s);
    sample.force_N.push_back(state_N + truth.white_N / std::sqrt(kReadings) * normal(random));
    sample.readings.push_back(kReadings);
    sample.columns.push_back({1.0});
  }
  const std::vector<NoiseSample> samples{sample};
  const auto score = [&](const NoiseModel& noise) { return noise_likelihood(samples, noise); };
  const auto climbed = [&](double along_the_ridge) {
    std::pair<NoiseModel, double> out{{0.33, 0.45, 100.0}, 0.0};
    out.second = score(out.first);
    climb(out.first, out.second,
          {.width = {0.1, 0.7, 1.0, along_the_ridge}, .passes = 10, .shortest_s = 5e-3, .longest_s = 3e3}, score);
    return out;
  };
  const auto [found, likelihood] = climbed(0.7);
  EXPECT_GE(likelihood, score(truth));
  EXPECT_GT(found.correlation_s, 5.0 / 1.7);
  EXPECT_LT(found.correlation_s, 5.0 * 1.7);
  EXPECT_LT(climbed(0.0).second, score(truth)) << "this start needs no move along the ridge";
}

}  // namespace
}  // namespace isorig::identify
