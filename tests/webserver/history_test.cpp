#include "webserver/rules/history.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

/// Rings of samples and of the day.
namespace isorig::web {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1000 * kMs;

TEST(Series, AnOutlierOfOneSampleIsInItsStretchAtEveryWidth) {
  Series series({10'000});
  double sum = 0.0;
  for (int i = 0; i < 10'000; ++i) {
    const double value = i == 4321 ? 50.0 : std::sin(i * 0.01);
    if (i >= 4320 && i < 4340) sum += value;
    series.push(i * kMs, value, -value);
  }
  for (const std::int64_t width : {2 * kMs, 20 * kMs, 777 * kMs, 20 * kSecond}) {
    const auto at = 4321 * kMs / width;
    const auto found = series.stretches(width, at, at + 1);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].index, at);
    EXPECT_EQ(found[0].high[0], 50.0F);
    EXPECT_EQ(found[0].low[1], -50.0F);
  }
  // The mean of 20 values of single precision.
  EXPECT_NEAR(series.stretches(20 * kMs, 216, 217)[0].mean[0], sum / 20.0, 20.0 * 50.0 * 6e-8);
}

TEST(Series, StretchesCutAtAnyPlaceAreTheSame) {
  Series series({5000});
  for (int i = 0; i < 12'345; ++i) series.push(i * kMs + 137, std::cos(i * 0.1));
  const auto whole = series.stretches(20 * kMs, 0, 10'000);
  EXPECT_EQ(*series.oldest_ns(), 7345 * kMs + 137);
  std::vector<Stretch> parts;
  for (std::int64_t at = 0; at < 10'000; at += 7) {
    for (const auto& s : series.stretches(20 * kMs, at, at + 7)) parts.push_back(s);
  }
  ASSERT_EQ(parts.size(), whole.size());
  EXPECT_EQ(whole.size(), 251U);  // 5000 ms of 20 ms, beginning and ending within one
  for (std::size_t i = 0; i < whole.size(); ++i) {
    EXPECT_EQ(parts[i].index, whole[i].index);
    EXPECT_EQ(parts[i].mean[0], whole[i].mean[0]);
  }
}

TEST(Series, AGapHasNoStretches) {
  Series series({1000});
  for (int i = 0; i < 100; ++i) series.push(i * kMs, 1.0);
  for (int i = 500; i < 600; ++i) series.push(i * kMs, 1.0);
  const auto found = series.stretches(20 * kMs, 0, 100);
  ASSERT_EQ(found.size(), 10U);
  EXPECT_EQ(found[4].index, 4);
  EXPECT_EQ(found[5].index, 25);
}

TEST(Series, AStampALittleBackIsKeptAndAnotherClockBeginsAnew) {
  Series series({1000});
  series.push(10 * kSecond, 1.0);
  series.push(10 * kSecond - kMs, 7.0);
  EXPECT_EQ(series.size(), 2U);
  EXPECT_EQ(*series.newest_ns(), 10 * kSecond);
  EXPECT_EQ(series.stretches(20 * kMs, 500, 501)[0].high[0], 7.0F);
  series.push(3 * kSecond, 2.0);
  EXPECT_EQ(series.restarts(), 1U);
  EXPECT_EQ(series.size(), 1U);
  EXPECT_EQ(*series.newest_ns(), 3 * kSecond);
}

TEST(Series, TheDayIsWholeAndItsOldestGoes) {
  Series series({100, 10, 5 * kSecond});
  for (int s = 0; s < 100; ++s) series.push(s * kSecond, s == 77 ? -5.0 : 1.0);
  const auto day = series.coarse(0);
  ASSERT_EQ(day.size(), 10U);  // 20 stretches of 5 s, the last one still open
  EXPECT_EQ(day.front().index, 9);
  EXPECT_EQ(day.back().index, 18);
  EXPECT_EQ(series.coarse_open(), 19);
  EXPECT_EQ(day[15 - 9].low[0], -5.0F);
  EXPECT_EQ(day[15 - 9].mean[0], -0.2F);  // (4 * 1 - 5) / 5
  EXPECT_EQ(series.coarse(17).size(), 2U);
}

TEST(History, TwentyFiveHoursTakeNoMoreMemoryThanNone) {
  History history;
  const auto before = history.bytes();
  daemon::FrameRecord frame;
  daemon::ControlRecord control;
  // 25 h in virtual time, the frame at 40 Hz: the rings wrap as they do at 1 kHz.
  for (std::int64_t i = 0; i < std::int64_t{25} * 3600 * 40; ++i) {
    frame.mono_ns = i * 25 * kMs;
    frame.sequence = static_cast<std::uint32_t>(i);
    frame.force_N = static_cast<double>(i % 1000);
    history.add(frame);
    history.add_twin(frame.mono_ns, frame.force_N, 0.02, 1.0);
    control.mono_ns = frame.mono_ns;
    if (i % 4 == 0) history.add(control);
  }
  EXPECT_EQ(history.bytes(), before);
  EXPECT_LT(before, 56U << 20U);
  EXPECT_EQ(history.series(Stream::kFrame).coarse(0).size(), 17'280U);
  EXPECT_EQ(history.series(Stream::kFrame).size(), 660'000U);
  EXPECT_EQ(history.series(Stream::kTwin).size(), 660'000U);
  EXPECT_EQ(history.series(Stream::kBand).coarse(0).size(), 17'280U);
  EXPECT_EQ(history.gaps(), 0U);
}

TEST(History, NumbersThatWereLeftOutAreCountedAndARestartIsNone) {
  History history;
  daemon::FrameRecord frame;
  for (const std::uint32_t sequence : {0xFFFF'FFFEU, 0xFFFF'FFFFU, 0U, 1U, 5U, 6U}) {
    frame.sequence = sequence;
    history.add(frame);
  }
  EXPECT_EQ(history.gaps(), 3U);
  frame.sequence = 0;  // the device was restarted
  history.add(frame);
  EXPECT_EQ(history.gaps(), 3U);
}

TEST(Lateness, CountsByPowersOfTwoAndForgetsAfterTenMinutes) {
  Lateness lateness;
  const std::uint32_t ns[] = {0, 999, 1000, 1999, 2000, 3'000'000, 4'000'000'000};
  for (const auto late : ns) lateness.add(kSecond, late);
  Lateness::Counts wanted{};
  wanted[0] = 2;   // below 1 us
  wanted[1] = 2;   // 1 us
  wanted[2] = 1;   // 2 us
  wanted[12] = 1;  // 2048 to 4096 us
  wanted[Lateness::kBins - 1] = 1;
  EXPECT_EQ(lateness.counts(), wanted);
  lateness.add(600 * kSecond, 0);
  ++wanted[0];
  EXPECT_EQ(lateness.counts(), wanted);
  lateness.add(601 * kSecond, 0);  // in the place of the first
  wanted = {};
  wanted[0] = 2;
  EXPECT_EQ(lateness.counts(), wanted);
  lateness.add(5 * kSecond, 0);
  wanted[0] = 1;
  EXPECT_EQ(lateness.counts(), wanted) << "what another clock had is kept";
}

TEST(Block, IsWhatThePageReads) {
  const auto bytes =
      block(Stream::kFrame, 1, 20 * kMs, {{1000, {1, 2}, {3, 4}, {5, 6}}, {1003, {7, 8}, {9, 10}, {11, 12}}});
  ASSERT_EQ(bytes.size(), 24U + 4U * 2U * 7U);
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v = 0;
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  const auto f32 = [&](std::size_t at) {
    float v = 0;
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  EXPECT_EQ(bytes[0], 0);
  EXPECT_EQ(bytes[1], 1);
  EXPECT_EQ(bytes[2], 6);
  EXPECT_EQ(u32(4), 2U);
  EXPECT_EQ(u32(24), 0U);
  EXPECT_EQ(u32(28), 3U);
  const float wanted[] = {1, 7, 3, 9, 5, 11, 2, 8, 4, 10, 6, 12};
  for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(f32(32 + 4 * i), wanted[i]) << i;
}

}  // namespace
}  // namespace isorig::web
