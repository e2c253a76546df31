// How well a channel was read, against channels whose noise and steps are known.
#include "identify/diagnose/signal/channel_quality.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::identify {
namespace {

constexpr std::size_t kRows = 20000;

std::vector<double> seconds() {
  std::vector<double> t_s;
  for (std::size_t k = 0; k < kRows; ++k) t_s.push_back(0.01 * static_cast<double>(k));
  return t_s;
}

/// A slow sine with white noise, rounded to steps (0: not rounded).
std::vector<double> channel(double noise, double step, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> out;
  for (const double t_s : seconds()) {
    const double value = 10.0 * std::sin(t_s / 50.0) + noise * normal(random);
    out.push_back(step > 0.0 ? step * std::round(value / step) : value);
  }
  return out;
}

// The median of n sizes of normal numbers errs by 1.17 / sqrt(2 n) of itself; neighbouring bends share readings, which
// adds a fifth: 0.7 % of 20000. Four of these standard errors.
TEST(ChannelQuality, MeasuresNoiseAndFindsNoStepInAFineChannel) {
  const ChannelQuality quality = channel_quality(seconds(), channel(0.1, 0.0, 1));
  EXPECT_NEAR(quality.noise, 0.1, 0.1 * 4.0 * 1.2 * 1.17 / std::sqrt(2.0 * kRows));
  EXPECT_EQ(quality.step, 0.0);
  EXPECT_EQ(quality.rounding(), 0.0);
}

TEST(ChannelQuality, MeasuresTheStepOfACoarseChannel) {
  const ChannelQuality quality = channel_quality(seconds(), channel(0.1, 0.25, 2));
  EXPECT_NEAR(quality.step, 0.25, 1e-12);
  EXPECT_NEAR(quality.rounding(), 0.25 / std::sqrt(12.0), 1e-12);
}

TEST(ChannelQuality, KeepsTheChannelsOfARecordingApart) {
  messages::Recording recording;
  recording.frame.t_s = seconds();
  recording.frame.position_mm = channel(0.002, 0.005, 3);
  recording.frame.force_N = channel(0.1, 0.0, 4);
  RecordingQuality quality = recording_quality(recording);
  EXPECT_NEAR(quality.position.step, 0.005, 1e-9);
  EXPECT_EQ(quality.force.step, 0.0);
  EXPECT_GT(quality.force.noise, 10.0 * quality.position.noise);
  EXPECT_EQ(quality.pressure.noise, 0.0);
  EXPECT_EQ(quality.pressure.step, 0.0);

  recording.pressure = messages::PressureSamples{seconds(), channel(0.02, 0.0, 5)};
  quality = recording_quality(recording);
  EXPECT_NEAR(quality.pressure.noise, 0.02, 0.02 * 4.0 * 1.2 * 1.17 / std::sqrt(2.0 * kRows));
}

}  // namespace
}  // namespace isorig::identify
