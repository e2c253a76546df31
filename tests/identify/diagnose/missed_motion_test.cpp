// Gaps that hide a motion, and those that do not.
#include "identify/diagnose/guard/missed_motion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace isorig::identify {
namespace {

/// A triangle of +-4 mm at 2 mm/s for 120 s, 20 readings a second; rows within `lost` are gone.
messages::FrameSamples triangle(std::initializer_list<std::pair<double, double>> lost) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 5e-4);
  messages::FrameSamples out;
  for (double t_s = 0.0; t_s < 120.0; t_s += 0.05) {
    bool gone = false;
    for (const auto& [from_s, to_s] : lost) gone = gone || (t_s > from_s && t_s < to_s);
    if (gone) continue;
    const double phase = std::fmod(t_s + 2.0, 8.0);
    out.t_s.push_back(t_s);
    out.position_mm.push_back((phase < 4.0 ? -4.0 + 2.0 * phase : 12.0 - 2.0 * phase) + noise(random));
    out.force_N.push_back(0.0);
  }
  return out;
}

std::vector<double> missed_in(const messages::FrameSamples& frame) {
  return missed_motion(frame, channel_quality(frame.t_s, frame.position_mm));
}

TEST(MissedMotion, IsWhereReadingsComeAgainAfterAGapInWhichTheSpecimenCouldHaveMoved) {
  EXPECT_TRUE(missed_in(triangle({})).empty());
  const auto ends = missed_in(triangle({{20.02, 23.01}, {60.02, 60.97}}));
  ASSERT_EQ(ends.size(), 2u);
  EXPECT_NEAR(ends[0], 23.05, 0.06);
  EXPECT_NEAR(ends[1], 61.0, 0.06);
}

TEST(MissedMotion, IsNoneWhereTheGapIsTooShortForAFiftiethOfTheStroke) {
  // 8 mm of stroke: 0.16 mm at 2 mm/s is 0.08 s; eight spacings are 0.4 s.
  EXPECT_TRUE(missed_in(triangle({{20.02, 20.32}})).empty());
  EXPECT_EQ(missed_in(triangle({{20.02, 20.62}})).size(), 1u);
}

TEST(MissedMotion, KeepsTheLongestTwelve) {
  std::initializer_list<std::pair<double, double>> lost = {
      {5.02, 6.0},   {13.02, 14.0}, {21.02, 22.0}, {29.02, 30.0}, {37.02, 38.0}, {45.02, 46.0},  {53.02, 54.0},
      {61.02, 62.0}, {69.02, 70.0}, {77.02, 78.0}, {85.02, 86.0}, {93.02, 94.0}, {101.02, 105.0}};
  const auto ends = missed_in(triangle(lost));
  ASSERT_EQ(ends.size(), 12u);
  EXPECT_TRUE(std::ranges::is_sorted(ends));
  EXPECT_NEAR(ends.back(), 105.0, 0.06);
}

TEST(MissedMotion, IsNoneInARecordingOfAFewRowsOrWithoutMotion) {
  messages::FrameSamples few = triangle({});
  for (auto* column : {&few.t_s, &few.position_mm, &few.force_N}) column->resize(12);
  EXPECT_TRUE(missed_in(few).empty());
  messages::FrameSamples still = triangle({{20.02, 23.01}});
  std::ranges::fill(still.position_mm, 1.0);
  EXPECT_TRUE(missed_in(still).empty());
}

}  // namespace
}  // namespace isorig::identify
