#include "daemon/host/event_history.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "daemon/core/fixed_text.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::ElementsAre;

EventRecord event(double at_s, const char* code, Severity severity, RunState from = RunState::kRunning,
                  RunState to = RunState::kRunning) {
  EventRecord e;
  e.mono_ns = static_cast<std::int64_t>(at_s * 1e9);
  e.severity = severity;
  e.from = from;
  e.to = to;
  copy_text(e.code, code);
  return e;
}

TEST(EventHistory, AFloodPushesNeitherFaultsNorTransitionsOut) {
  EventHistory history(100);
  EXPECT_TRUE(history.add(event(0.0, "run.start", Severity::kInfo, RunState::kReady, RunState::kRunning)));
  EXPECT_TRUE(history.add(event(1.0, "limit.force", Severity::kProgramStop)));
  for (int i = 0; i < 5000; ++i) history.add(event(2.0 + i, "step", Severity::kInfo));
  const auto all = history.after(0);
  EXPECT_EQ(all.size(), 102U);
  EXPECT_STREQ(all[0].record.code, "run.start");
  EXPECT_STREQ(all[1].record.code, "limit.force");
  EXPECT_EQ(all.back().number, history.last_number());
}

TEST(EventHistory, WarningsOfOneKindBecomeOneEntryASecond) {
  EventHistory history(100);
  int told = 0;
  for (int i = 0; i < 300; ++i) {  // two kinds in turns, 100 a second each, for 3 s
    auto lost = event(0.01 * i, "lost.record", Severity::kWarning);
    lost.value = i;
    told += history.add(lost) ? 1 : 0;
    told += history.add(event(0.01 * i, "lost.frame", Severity::kWarning)) ? 1 : 0;
  }
  EXPECT_EQ(told, 6);
  const auto all = history.after(0);
  ASSERT_EQ(all.size(), 6U);
  EXPECT_EQ(all[0].count + all[2].count + all[4].count, 300U);
  EXPECT_EQ(all[4].record.value, 299.0);
  // Who has seen the first part of one is shown it again when it has grown.
  const auto seen = history.last_number();
  history.add(event(2.995, "lost.record", Severity::kWarning));
  ASSERT_EQ(history.after(seen).size(), 1U);
  EXPECT_STREQ(history.after(seen)[0].record.code, "lost.record");
}

TEST(EventHistory, StepsAreNeverCollapsed) {
  EventHistory history(100);
  EXPECT_TRUE(history.add(event(0.0, "step", Severity::kInfo)));
  EXPECT_TRUE(history.add(event(0.001, "step", Severity::kInfo)));
  EXPECT_EQ(history.after(0).size(), 2U);
}

}  // namespace
}  // namespace isorig::daemon::test
