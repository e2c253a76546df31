#include "drivers/clock_map/sync_line.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace isorig::clock {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kPeriod = 500 * kMs;

/// A line that changes each half second, and a mapping that is `late_us` off and claims `bound_us`.
class SyncLineTest : public ::testing::Test {
 protected:
  static bool rising(int edge) { return edge % 2 == 1; }
  static std::int64_t at_ns(int edge) { return 10'000 * kMs + edge * kPeriod; }

  void seen(int edge) { line.line_edge(at_ns(edge), rising(edge)); }
  void announced(int edge, double late_us = 0.0) {
    line.device_edge(1e6 + 5e5 * edge, rising(edge),
                     {at_ns(edge) + static_cast<std::int64_t>(late_us * 1e3), bound_us * 1e3, 8e3});
  }
  void run_until(std::int64_t now_ns) {
    while (const auto check = line.next(now_ns)) checks.push_back(*check);
  }
  void settle(int edge) { run_until(at_ns(edge) + 400 * kMs); }

  double bound_us = 300.0;
  SyncLine line;
  std::vector<SyncCheck> checks;
};

TEST_F(SyncLineTest, MeasuresTheMappingByEachEdge) {
  for (int edge = 1; edge <= 10; ++edge) {
    if (edge % 3 == 0) announced(edge, 40.0);  // whichever comes first
    seen(edge);
    if (edge % 3 != 0) announced(edge, 40.0);
    settle(edge);
  }
  ASSERT_EQ(checks.size(), 10U);
  EXPECT_NEAR(checks[4].error_us, 40.0, 1e-3);
  EXPECT_EQ(checks[4].mono_ns, at_ns(5));
  EXPECT_TRUE(checks[4].within && checks[4].rising);
  EXPECT_DOUBLE_EQ(checks[4].bound_us, 300.0);
  EXPECT_NEAR(line.counts().mean_us, 40.0, 1e-3);
  EXPECT_NEAR(line.counts().rms_us, 40.0, 1e-3);
  EXPECT_EQ(line.counts().unseen + line.counts().unannounced + line.counts().ambiguous, 0U);
}

TEST_F(SyncLineTest, AMappingBeyondItsBoundIsAnErrorAndNoMissingEdge) {
  seen(1);
  announced(1, -20'000.0);
  settle(1);
  ASSERT_EQ(checks.size(), 1U);
  EXPECT_FALSE(checks[0].within);
  EXPECT_NEAR(checks[0].error_us, -20'000.0, 1e-3);
  EXPECT_EQ(line.counts().outside, 1U);
  EXPECT_DOUBLE_EQ(line.counts().worst_us, 20'000.0);
}

TEST_F(SyncLineTest, WaitsForTheOtherSide) {
  announced(1);
  run_until(at_ns(1) + 200 * kMs);
  EXPECT_EQ(line.counts().unseen, 0U);
  seen(1);  // a thread that was late hands it over now
  settle(1);
  EXPECT_EQ(checks.size(), 1U);
}

TEST_F(SyncLineTest, EdgesMissedOnEitherSideShiftNothing) {
  for (int edge = 1; edge <= 20; ++edge) {
    if (edge != 5 && edge != 6) seen(edge);
    if (edge != 11) announced(edge, 10.0);
    settle(edge);
  }
  run_until(at_ns(22));
  EXPECT_EQ(checks.size(), 17U);
  for (const auto& check : checks) EXPECT_NEAR(check.error_us, 10.0, 1e-3);
  EXPECT_EQ(line.counts().unseen, 2U);
  EXPECT_EQ(line.counts().unannounced, 1U);
}

TEST_F(SyncLineTest, ALineUpsideDownIsFoundOut) {
  for (int edge = 1; edge <= 3; ++edge) {
    line.line_edge(at_ns(edge), !rising(edge));
    announced(edge);
    settle(edge);
    EXPECT_EQ(line.counts().inverted, edge == 3);
  }
  EXPECT_TRUE(checks.empty());
  EXPECT_EQ(line.counts().wrong_polarity, 3U);
  seen(4);
  announced(4);
  settle(4);
  EXPECT_FALSE(line.counts().inverted) << "mended";
}

TEST_F(SyncLineTest, EdgesFromBeforeTheDeviceSpokeAreNobodys) {
  for (int edge = 1; edge <= 6; ++edge) seen(edge);
  announced(6);
  settle(6);
  EXPECT_EQ(checks.size(), 1U);
  EXPECT_EQ(line.counts().unannounced, 0U);
}

TEST_F(SyncLineTest, TheFirstEdgesOfAMappingThatKnowsNothingAreNotGuessed) {
  bound_us = MappedTime::kUnknown;
  seen(1);
  announced(1);
  bound_us = 60'000.0;  // wider than the window
  seen(2);
  announced(2);
  settle(2);
  EXPECT_TRUE(checks.empty());
  EXPECT_EQ(line.counts().unmapped, 2U);
  bound_us = 400.0;
  seen(3);
  announced(3);
  settle(3);
  EXPECT_EQ(checks.size(), 1U);
}

TEST_F(SyncLineTest, ABounceIsAmbiguous) {
  seen(1);
  line.line_edge(at_ns(1) + kMs, false);
  line.line_edge(at_ns(1) + 2 * kMs, true);
  announced(1);
  settle(1);
  EXPECT_TRUE(checks.empty());
  EXPECT_EQ(line.counts().ambiguous, 1U);
}

TEST_F(SyncLineTest, PulsesTooCloseTogetherAreNotPairedWithANeighbour) {
  // 30 ms apart, and the line's edge of the second pulse is missing.
  line.device_edge(1e6, true, {at_ns(1), 3e5, 8e3});
  line.device_edge(1.03e6, true, {at_ns(1) + 30 * kMs, 3e5, 8e3});
  line.line_edge(at_ns(1), true);
  settle(1);
  EXPECT_TRUE(checks.empty());
  EXPECT_EQ(line.counts().ambiguous + line.counts().unseen, 2U);
}

TEST_F(SyncLineTest, AReconnectBeginsAnew) {
  seen(1);
  announced(2);
  line.forget();
  run_until(at_ns(4));
  EXPECT_EQ(line.counts(), SyncCounts{});
}

TEST_F(SyncLineTest, ANoisyLineDoesNotFillTheMemory) {
  announced(0);
  for (int i = 0; i < 100'000; ++i) line.line_edge(at_ns(1) + i, i % 2 == 0);
  run_until(at_ns(4));
  EXPECT_EQ(line.counts().unannounced, 100'000U);
}

}  // namespace
}  // namespace isorig::clock
