// What a row weighs: by the readings it stands for, and by the noise at its time.
#include "identify/diagnose/fit/row_weights.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace isorig::identify {
namespace {

/// 100 rows a second for 200 s, the noise as a function of time.
template <typename Noise>
messages::FrameSamples record(Noise noise_N, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  messages::FrameSamples out;
  for (int k = 0; k < 20000; ++k) {
    const double t_s = 0.01 * k;
    out.t_s.push_back(t_s);
    out.position_mm.push_back(0.0);
    out.force_N.push_back(10.0 * std::sin(t_s / 5.0) + noise_N(t_s) * normal(random));
  }
  return out;
}

RowWeights weights_of(const messages::FrameSamples& frame) {
  return row_weights(frame, channel_quality(frame.t_s, frame.force_N));
}

// 40 groups of 500 bends: a median of 500 sizes errs by 1.17 / sqrt(2 * 500) = 3.7 % (more by a fifth, since
// neighbouring bends share readings), and the ends of the line by 2 sigma / sqrt(40): 1.4 %. Precisions err by twice
// that.
TEST(RowWeights, FollowANoiseThatGrowsOverTheSession) {
  const auto noise_N = [](double t_s) { return 0.1 * std::exp(t_s / 200.0); };
  const messages::FrameSamples frame = record(noise_N, 1);
  const RowWeights weights = weights_of(frame);
  const double mean_square = 0.01 * (std::exp(2.0) - 1.0) / 2.0;
  for (const std::size_t k : {0U, 10000U, 19999U})
    EXPECT_NEAR(weights.precision[k] * std::pow(noise_N(frame.t_s[k]), 2) / mean_square, 1.0, 3.0 * 0.028) << k;
  EXPECT_EQ(weights.per_row[0], 1.0);
}

TEST(RowWeights, AreAlikeWhereTheNoiseDoesNotGrow) {
  for (unsigned seed = 1; seed <= 20; ++seed)
    EXPECT_EQ(weights_of(record([](double) { return 0.1; }, seed)).precision, std::vector<double>(20000, 1.0)) << seed;
}

// Every other 25 s move, and read noisier: no line in time.
TEST(RowWeights, AreAlikeWhereTheNoiseComesAndGoes) {
  const auto noise_N = [](double t_s) { return std::fmod(t_s, 50.0) < 25.0 ? 0.1 : 0.2; };
  EXPECT_EQ(weights_of(record(noise_N, 2)).precision, std::vector<double>(20000, 1.0));
}

TEST(RowWeights, OfAReadingThatStandsOnItsStepsAreAlike) {
  messages::FrameSamples frame = record([](double t_s) { return 0.01 * std::exp(t_s / 100.0); }, 3);
  for (double& force_N : frame.force_N) force_N = std::round(force_N / 0.5) * 0.5;
  EXPECT_EQ(weights_of(frame).precision, std::vector<double>(20000, 1.0));
}

}  // namespace
}  // namespace isorig::identify
