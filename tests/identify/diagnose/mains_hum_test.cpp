// A hum that was put in is found with its frequency and amplitude, and none is found where there is none.
#include "identify/diagnose/signal/mains_hum.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace isorig::identify {
namespace {

struct Channel {
  std::vector<double> t_s, reading, hum;
  std::vector<bool> single;
};

struct Put {
  double amplitude = 0.0, frequency_Hz = 50.0;
  double wander_Hz = 0.0;  ///< amplitude of a slow swing of the frequency
  double second = 0.0;     ///< harmonic, share of the amplitude
  double noise = 1.0;
  double spacing_s = 0.2;  ///< mean; stamps jitter by a tenth of it
  double jitter = 0.1;
  double duration_s = 300.0;
  unsigned seed = 1;
};

/// Slow motion of 100 noises, noise and hum.
Channel record(const Put& put) {
  std::mt19937 random(put.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Channel out;
  constexpr double kSwing_s = 150.0;
  for (double t = 0.0; t < put.duration_s; t += put.spacing_s) {
    const double t_s = t + put.jitter * put.spacing_s * uniform(random);
    const double turn = 2.0 * std::numbers::pi *
                        (put.frequency_Hz * t_s + put.wander_Hz * kSwing_s / (2.0 * std::numbers::pi) *
                                                      std::sin(2.0 * std::numbers::pi * t_s / kSwing_s));
    out.t_s.push_back(t_s);
    out.hum.push_back(put.amplitude * (std::sin(turn + 0.7) + put.second * std::cos(2.0 * turn)));
    out.reading.push_back(100.0 * put.noise * std::sin(t_s / 20.0) + put.noise * normal(random) + out.hum.back());
    out.single.push_back(true);
  }
  return out;
}

double rms_error(const Channel& channel, const MainsHum& hum) {
  double sum = 0.0;
  for (std::size_t k = 0; k < channel.hum.size(); ++k) sum += std::pow(hum.reading[k] - channel.hum[k], 2);
  return std::sqrt(sum / static_cast<double>(channel.hum.size()));
}

// Three numbers from n readings of noise s err by s sqrt(3 / n) rms; a row against its neighbours keeps half of what it
// tells or more.
TEST(MainsHum, IsRecoveredWithinWhatTheNoiseAllows) {
  for (const double mains_Hz : {49.93, 50.02, 60.05}) {
    const Channel channel = record({.amplitude = 1.0, .frequency_Hz = mains_Hz});
    const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
    ASSERT_TRUE(hum) << mains_Hz;
    const double error = std::sqrt(2.0 * 3.0 / static_cast<double>(channel.t_s.size()));
    EXPECT_NEAR(hum->frequency_Hz, mains_Hz, 1.0 / (2.0 * 300.0));
    EXPECT_NEAR(hum->amplitude, 1.0, 3.0 * error);
    EXPECT_LT(rms_error(channel, *hum), 3.0 * error);
    EXPECT_TRUE(hum->steady);
  }
}

TEST(MainsHum, IsFoundWithItsSecondHarmonic) {
  const Channel channel = record({.amplitude = 2.0, .second = 0.5});
  const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
  ASSERT_TRUE(hum);
  EXPECT_NEAR(hum->amplitude, 2.0 * std::hypot(1.0, 0.5), 0.2);
  EXPECT_LT(rms_error(channel, *hum), 3.0 * std::sqrt(2.0 * 5.0 / static_cast<double>(channel.t_s.size())));
}

// The mains swing by 20 mHz: the phase by one turn and more. Fifteen windows of two numbers each err by
// s sqrt(30 n / n^2) rms at least, twice that since a row against its neighbours tells half of what it could; phases
// between the windows' middles (20 s; curvature 2 pi 0.02 2 pi / 150 rad/s^2) are off by 0.26 rad at most, 0.18 rms.
TEST(MainsHum, IsFollowedWhereItWanders) {
  const Channel channel = record({.amplitude = 2.0, .wander_Hz = 0.02});
  const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
  ASSERT_TRUE(hum);
  EXPECT_FALSE(hum->steady);
  const double noise = std::sqrt(2.0 * 30.0 / static_cast<double>(channel.t_s.size()));
  EXPECT_LT(rms_error(channel, *hum), std::hypot(noise, 0.18 * 2.0 / std::numbers::sqrt2));
}

// At 50 readings a second a hum of 50 Hz is a slow wave: the jitter of the stamps is what tells it from a drift.
TEST(MainsHum, IsFoundWhereItIsFoldedDownToASlowWave) {
  const Channel channel = record({.amplitude = 1.0, .frequency_Hz = 50.01, .spacing_s = 0.02, .duration_s = 120.0});
  const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
  ASSERT_TRUE(hum);
  EXPECT_NEAR(hum->frequency_Hz, 50.01, 1.0 / 240.0);
  EXPECT_NEAR(hum->amplitude, 1.0, 0.1);
}

// An hour is searched in steps for ten minutes: a hum between two of them is followed from window to window. 181
// windows of two numbers each, and twice the variance, since a row against its neighbours tells half of what it could.
TEST(MainsHum, IsFollowedThroughARecordingOfAnHour) {
  const Channel channel = record({.amplitude = 2.0, .frequency_Hz = 50.0102, .duration_s = 3600.0});
  const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
  ASSERT_TRUE(hum);
  EXPECT_NEAR(hum->frequency_Hz, 50.0102, 1.0 / 2400.0);
  EXPECT_LT(rms_error(channel, *hum), 1.5 * std::sqrt(2.0 * 363.0 / static_cast<double>(channel.t_s.size())));
}

TEST(MainsHum, IsNotFoundWhereThereIsNone) {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Channel channel = record({.spacing_s = seed % 2 == 0 ? 0.2 : 0.01, .duration_s = 100.0, .seed = seed});
    EXPECT_FALSE(find_mains_hum(channel.t_s, channel.reading, channel.single)) << seed;
    // Neither in coloured noise, nor in a ripple of 47 Hz, which is none of the mains'.
    double slow = 0.0;
    for (std::size_t k = 0; k < channel.t_s.size(); ++k) {
      slow = 0.9 * slow + channel.reading[k] * 0.02;
      channel.reading[k] += slow + 0.5 * std::sin(2.0 * std::numbers::pi * 47.0 * channel.t_s[k]);
    }
    EXPECT_FALSE(find_mains_hum(channel.t_s, channel.reading, channel.single)) << seed;
  }
}

TEST(MainsHum, LeavesMeansAloneAndSaysNothingOfWhatItCannotTell) {
  Channel channel = record({.amplitude = 3.0});
  for (std::size_t k = 0; k < channel.single.size(); ++k) channel.single[k] = k < 1000;
  const auto hum = find_mains_hum(channel.t_s, channel.reading, channel.single);
  ASSERT_TRUE(hum);
  for (std::size_t k = 1000; k < channel.single.size(); ++k) EXPECT_EQ(hum->reading[k], 0.0);

  // Every row at the same phase: a constant.
  const Channel folded = record({.amplitude = 3.0, .jitter = 0.0});
  EXPECT_FALSE(find_mains_hum(folded.t_s, folded.reading, folded.single));
  const Channel few = record({.amplitude = 3.0, .duration_s = 30.0});
  EXPECT_FALSE(find_mains_hum(few.t_s, few.reading, few.single));
  EXPECT_FALSE(find_mains_hum({}, {}, {}));
}

}  // namespace
}  // namespace isorig::identify
