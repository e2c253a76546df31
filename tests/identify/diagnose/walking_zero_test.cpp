// A zero of the force that walks at random is told from what else a residual may be by where and how fast it moves.
#include "identify/diagnose/noise/walking_zero.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {
namespace {

constexpr double kWhite_N = 0.02;
constexpr double kRate_N2_s = 4e-5;  // 2 s of it are half of the white noise of a reading
constexpr int kSeeds = 20;

const Series& bench() {
  static const Series series = prepare_series("bench", test::record({.force_noise_N = kWhite_N, .seed = 3}), {});
  return series;
}

bool rests(std::size_t bin) {
  return std::fabs(bench().nodes[bin].velocity_mm_s) < still_mm_s(bench());
}

/// White noise of the bins, and what `adds` says.
Eigen::VectorXd residual(unsigned seed, const std::function<double(std::size_t bin, std::mt19937&)>& adds) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Eigen::VectorXd out(static_cast<Eigen::Index>(bench().nodes.size()));
  for (std::size_t bin = 0; bin < bench().nodes.size(); ++bin) {
    const double readings = std::max(bench().count[bin], 1.0);
    out[static_cast<Eigen::Index>(bin)] = kWhite_N / std::sqrt(readings) * normal(random) + adds(bin, random);
  }
  return out;
}

double step_s(std::size_t bin) {
  return bin == 0 ? 0.0 : bench().nodes[bin].t_s - bench().nodes[bin - 1].t_s;
}

/// Of independent normal steps with the variance `rate(bin)` times the time between.
Eigen::VectorXd walk(unsigned seed, const std::function<double(std::size_t bin)>& rate) {
  std::normal_distribution<double> normal;
  double level_N = 0.0;
  return residual(seed, [&](std::size_t bin, std::mt19937& random) {
    return level_N += std::sqrt(rate(bin) * step_s(bin)) * normal(random);
  });
}

int found(const std::function<Eigen::VectorXd(unsigned seed)>& of) {
  int count = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) count += walking_zero(bench(), of(seed), kWhite_N) ? 1 : 0;
  return count;
}

/// One rate for rest and motion is refused by chance in 0.5 % (`allowed_noise_log` nats, chi-square with one degree),
/// and the growth rarer: more than one of twenty is no chance.
TEST(WalkingZero, IsFound) {
  EXPECT_GE(found([](unsigned seed) { return walk(seed, [](std::size_t) { return kRate_N2_s; }); }), kSeeds - 1);
}

/// The rate of n blocks whose steps are the walk's, white noise being nothing beside it, is known to sqrt(2 / n) of
/// itself; three of that.
TEST(WalkingZero, HasItsRate) {
  constexpr double kFast_N2_s = 100.0 * kRate_N2_s;
  const double lasts_s = bench().nodes.back().t_s - bench().nodes.front().t_s;
  const double error = std::sqrt(2.0 / (lasts_s / 2.0));
  int count = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto zero = walking_zero(bench(), walk(seed, [](std::size_t) { return kFast_N2_s; }), kWhite_N);
    if (!zero) continue;
    ++count;
    EXPECT_NEAR(zero->rate_N2_s, kFast_N2_s, 3.0 * error * kFast_N2_s) << seed;
    EXPECT_NEAR(zero->rms_N(100.0), 10.0 * std::sqrt(zero->rate_N2_s), 1e-12);
  }
  EXPECT_GE(count, kSeeds - 1);
}

TEST(WalkingZero, IsNotWhatMovesWithTheSpecimen) {
  EXPECT_EQ(
      found([](unsigned seed) { return walk(seed, [](std::size_t bin) { return rests(bin) ? 0.0 : kRate_N2_s; }); }),
      0);
  // A tenth of the rate at rest is far outside of chance, too.
  EXPECT_EQ(found([](unsigned seed) {
              return walk(seed, [](std::size_t bin) { return rests(bin) ? 0.1 * kRate_N2_s : kRate_N2_s; });
            }),
            0);
}

TEST(WalkingZero, IsNotWhatMovesAtRestAlone) {
  EXPECT_EQ(
      found([](unsigned seed) { return walk(seed, [](std::size_t bin) { return rests(bin) ? kRate_N2_s : 0.0; }); }),
      0);
}

TEST(WalkingZero, IsNoNoiseThatForgets) {
  EXPECT_EQ(found([](unsigned seed) { return residual(seed, [](std::size_t, std::mt19937&) { return 0.0; }); }), 0);
  for (const double correlation_s : {0.1, 1.0, 3.0}) {
    SCOPED_TRACE(correlation_s);
    const auto forgets = [&](unsigned seed) {
      std::normal_distribution<double> normal;
      double state = 0.0;
      return residual(seed, [&](std::size_t bin, std::mt19937& random) {
        const double kept = std::exp(-step_s(bin) / correlation_s);
        state = kept * state + std::sqrt(1.0 - kept * kept) * normal(random);
        return 1.5 * kWhite_N * state;
      });
    };
    EXPECT_EQ(found(forgets), 0);
  }
}

TEST(WalkingZero, IsNoDriftByALaw) {
  const double lasts_s = bench().nodes.back().t_s - bench().nodes.front().t_s;
  for (const double size_N : {0.3, 1.0, 3.0}) {
    SCOPED_TRACE(size_N);
    const auto straight = [&](std::size_t bin, std::mt19937&) { return size_N * bench().nodes[bin].t_s / lasts_s; };
    EXPECT_EQ(found([&](unsigned seed) { return residual(seed, straight); }), 0);
    const auto settles = [&](std::size_t bin, std::mt19937&) {
      return -size_N * std::expm1(-3.0 * bench().nodes[bin].t_s / lasts_s);
    };
    EXPECT_EQ(found([&](unsigned seed) { return residual(seed, settles); }), 0);
  }
}

/// Readings of the ramps alone show no rest to compare with.
TEST(WalkingZero, NeedsRests) {
  Series moves = bench();
  for (std::size_t bin = 0; bin < moves.nodes.size(); ++bin)
    if (rests(bin)) moves.count[bin] = 0.0;
  EXPECT_FALSE(walking_zero(moves, walk(1, [](std::size_t) { return kRate_N2_s; }), kWhite_N));
}

TEST(WalkingZero, IsANoiseThatForgetsLaterThanTheRecordingEnds) {
  const std::vector<Series> series{bench()};
  const double lasts_s = bench().nodes.back().t_s - bench().nodes.front().t_s;
  EXPECT_TRUE(is_walk({kWhite_N, 1.0, 1.1 * lasts_s}, series));
  EXPECT_FALSE(is_walk({kWhite_N, 1.0, 0.9 * lasts_s}, series));
  EXPECT_FALSE(is_walk({kWhite_N, 0.0, 1.1 * lasts_s}, series));
}

}  // namespace
}  // namespace isorig::identify
