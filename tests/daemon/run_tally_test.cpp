// What is counted of a recording while it is read: sums over batches, the span of the samples, and which end mark
// belongs to which repetition.
#include "daemon/recording/run_tally.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/recording/session_marks.hpp"

namespace isorig::daemon {
namespace {

using isorig_msgs::event_t;
using isorig_msgs::session_mark_t;

session_mark_t mark(std::int8_t kind, std::int32_t attempt, std::int32_t repetition, std::int64_t mono_ns) {
  session_mark_t m{};
  m.kind = kind;
  m.attempt = attempt;
  m.session.repetition = repetition;
  m.mono_ns = mono_ns;
  return m;
}

session_mark_t end(std::int32_t attempt, std::int32_t repetition, std::int64_t mono_ns, bool complete,
                   std::int64_t frame_missing, std::int64_t pressure_missing, std::int64_t dropped) {
  auto m = mark(session_mark_t::END, attempt, repetition, mono_ns);
  m.complete = complete ? 1 : 0;
  m.frame_missing = frame_missing;
  m.pressure_missing = pressure_missing;
  m.dropped_records = dropped;
  return m;
}

/// Times from `from_ns` on, 1 ms apart, each certain to within `bound_ns`.
isorig_msgs::pressure_batch_t pressures(std::int64_t from_ns, std::int16_t count, float bound_ns) {
  isorig_msgs::pressure_batch_t m{};
  m.count = count;
  m.mono_ns = from_ns;
  for (std::int32_t i = 0; i < count; ++i) m.mono_offset_ns.push_back(1'000'000 * i);
  m.bound_ns.assign(static_cast<std::size_t>(count), bound_ns);
  return m;
}

TEST(RunTally, CountsSamplesAveragesAndTheWorstBound) {
  RunTally tally;
  tally.pressure(pressures(5'000'000, 4, 20.0e3F));
  tally.pressure(pressures(9'000'000, 2, 70.0e3F));
  isorig_msgs::pressure_average_batch_t averages{};
  averages.count = 2;
  averages.first_mono_ns = {11'000'000, 16'000'000};
  averages.last_mono_ns = {15'000'000, 20'000'000};
  averages.samples = {5, 5};
  averages.bound_ns = {30'000, 40'000};
  tally.pressure_average(averages);
  EXPECT_EQ(tally.pressures.full, 6U);
  EXPECT_EQ(tally.pressures.averaged, 10U);
  EXPECT_EQ(tally.pressures.intervals, 2U);
  EXPECT_DOUBLE_EQ(tally.pressures.worst_bound_us, 70.0);
  EXPECT_EQ(tally.frames.full, 0U);
  EXPECT_EQ(tally.first_sample_ns, 5'000'000);
  EXPECT_EQ(tally.last_sample_ns, 20'000'000);
}

TEST(RunTally, SpanBeginsWithTheEarliestSampleNotTheFirstMessage) {
  RunTally tally;
  tally.pressure(pressures(3'000'000, 2, 0.0F));
  tally.pressure(pressures(0, 1, 0.0F));  // virtual time may begin at zero: no sentinel
  tally.pressure(pressures(8'000'000, 1, 0.0F));
  EXPECT_EQ(tally.first_sample_ns, 0);
  EXPECT_EQ(tally.last_sample_ns, 8'000'000);
  tally.pressure(pressures(99'000'000, 0, 0.0F));  // an empty batch has no time
  EXPECT_EQ(tally.last_sample_ns, 8'000'000);
}

// The clock of a further attempt is of another boot, before or behind the first; attempts lie end to end.
TEST(RunTally, AttemptsLieEndToEndWhateverTheirClocks) {
  for (const std::int64_t boot_ns : {-36'000'000'000'000, 36'000'000'000'000}) {
    RunTally tally;
    isorig_msgs::run_header_t h{};
    isorig_msgs::control_batch_t loop{};
    loop.count = 1;
    loop.samples.resize(1);
    h.attempt = 1;
    h.epoch_unix_us = 77;
    tally.header(h);
    tally.session(mark(session_mark_t::BEGIN, 1, 1, 1'000'000));
    tally.pressure(pressures(1'000'000, 4, 0.0F));
    for (const int overruns : {100, 103}) {
      loop.samples[0].overruns = overruns;
      tally.control(loop);
    }
    tally.header(h);  // of the next segment: no attempt of its own
    tally.pressure(pressures(5'000'000, 4, 0.0F));
    h.attempt = 2;
    h.epoch_unix_us = 99;
    tally.header(h);
    isorig_msgs::event_t resumed{};
    resumed.mono_ns = boot_ns;
    tally.event(resumed);
    tally.session(mark(session_mark_t::BEGIN, 2, 2, boot_ns + 2'000'000));
    tally.pressure(pressures(boot_ns + 2'000'000, 5, 0.0F));
    for (const int overruns : {7, 9}) {
      loop.samples[0].overruns = overruns;
      tally.control(loop);
    }
    EXPECT_EQ(tally.first_sample_ns, 1'000'000);
    EXPECT_EQ(tally.last_sample_ns, 14'000'000);  // 8 ms of the first, then 2 + 4
    EXPECT_EQ(tally.events[0].mono_ns, 8'000'000);
    EXPECT_EQ(tally.events[0].mono_ns - tally.event_shift_ns[0], boot_ns);
    EXPECT_EQ(tally.marks[1].mono_ns, 10'000'000);
    EXPECT_EQ(tally.marks[1].mono_ns - tally.mark_shift_ns[1], boot_ns + 2'000'000);
    EXPECT_EQ(tally.mark_shift_ns[0], 0);
    EXPECT_EQ(tally.first_epoch_unix_us, 77);
    EXPECT_EQ(tally.overruns, 3 + 2);
  }
}

// Missing samples are counted over an attempt: a repetition's share is what was added since the end before it.
TEST(RunTally, RepetitionsEndWithTheirOwnMarks) {
  RunTally tally;
  tally.session(mark(session_mark_t::BEGIN, 1, 1, 100));
  tally.session(end(1, 1, 200, true, 3, 1, 0.0F));
  tally.session(mark(session_mark_t::BEGIN, 1, 2, 300));  // cut off: the attempt ended here
  tally.session(mark(session_mark_t::BEGIN, 2, 2, 400));
  tally.session(mark(session_mark_t::CONTINUE, 2, 2, 450));
  tally.session(end(2, 2, 500, true, 2, 0, 4));
  tally.session(mark(session_mark_t::BEGIN, 2, 3, 600));
  tally.session(end(2, 3, 700, false, 7, 5, 6));
  const auto repetitions = tally.repetitions();
  ASSERT_EQ(repetitions.size(), 4U);
  EXPECT_STREQ(repetitions[0].state_text(), "complete");
  EXPECT_EQ(repetitions[0].end_ns, 200);
  EXPECT_EQ(repetitions[0].frame_missing, 3);
  EXPECT_STREQ(repetitions[1].state_text(), "cut off or running");
  EXPECT_FALSE(repetitions[1].ended);
  EXPECT_EQ(repetitions[2].begin.attempt, 2);
  EXPECT_EQ(repetitions[2].frame_missing, 2);
  EXPECT_EQ(repetitions[2].end_ns, 500);
  EXPECT_STREQ(repetitions[3].state_text(), "stopped, or not whole");
  EXPECT_EQ(repetitions[3].frame_missing, 5);
  EXPECT_EQ(repetitions[3].pressure_missing, 5);
  // Over the attempts the last counts are added up: 3 + 7, 1 + 5, 0 + 6.
  const auto losses = tally.losses();
  EXPECT_EQ(losses.frame, 10);
  EXPECT_EQ(losses.pressure, 6);
  EXPECT_EQ(losses.dropped, 6);
}

TEST(RunTally, KeepsTheWorstOfTheLoop) {
  RunTally tally;
  isorig_msgs::control_batch_t m{};
  m.count = 2;
  m.samples.resize(2);
  m.samples[0].overruns = 1;
  m.samples[0].worst_wakeup_ns = 900;
  m.samples[0].worst_run_ns = 10;
  m.samples[1].overruns = 2;
  m.samples[1].worst_wakeup_ns = 300;
  m.samples[1].worst_run_ns = 50;
  tally.control(m);
  EXPECT_EQ(tally.overruns, 1) << "the loop had one before the run";
  EXPECT_EQ(tally.worst_wakeup_ns, 900);
  EXPECT_EQ(tally.worst_run_ns, 50);
  // A sample ends at 2.1 s, the event does not.
  event_t late{};
  late.code = "loop.late";
  late.value = 5.0;
  tally.event(late);
  EXPECT_EQ(tally.worst_wakeup_ns, 5'000'000'000);
}

TEST(RunTally, ASeverityOutOfRangeHasNoName) {
  event_t event{};
  event.severity = event_t::PROGRAM_STOP;
  EXPECT_STREQ(severity_text(event), "program stop");
  for (const auto damaged : {std::int8_t{-1}, std::int8_t{4}, std::int8_t{127}}) {
    event.severity = damaged;
    EXPECT_STREQ(severity_text(event), "?");
  }
}

}  // namespace
}  // namespace isorig::daemon
