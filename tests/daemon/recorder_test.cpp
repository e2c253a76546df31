#include "daemon/recording/recorder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lcm/eventlog.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <thread>

#include "daemon/recording/run_directory.hpp"
#include "recording_rig.hpp"

namespace isorig::daemon::testing {
namespace {

using ::testing::HasSubstr;

/// Two ramps in slow surroundings, over three steps, at odd milliseconds.
const std::vector<Stretch> kTwoRamps{{3'217, 0, Keep::kAveraged},  {4'751, 1, Keep::kFull},
                                     {9'003, 2, Keep::kAveraged},  {9'777, 3, Keep::kFull},
                                     {10'111, 3, Keep::kAveraged}, {12'500, 4, Keep::kAveraged}};

messages::ReadReport record(const std::filesystem::path& dir, const RecorderOptions& options,
                            const std::vector<Stretch>& plan, Collected& out, std::int64_t drain_every_ms = 20,
                            const RunInfo& info = run_info()) {
  Streams streams;
  Recorder recorder(options, info);
  run_plan(recorder, streams, plan, drain_every_ms);
  recorder.finish(streams, true);
  EXPECT_EQ(streams.dropped(), 0U);
  return messages::read_run(dir, out);
}

/// Was sample i, at full rate, due in full by the policy?
bool due_in_full(std::int64_t mono_ns, const std::vector<std::pair<std::int64_t, std::int64_t>>& full) {
  return std::any_of(full.begin(), full.end(), [&](const auto& f) { return mono_ns >= f.first && mono_ns < f.second; });
}

TEST(Recorder, EveryValueOfEveryStreamComesBackAsItWas) {
  const TemporaryDirectory dir("recorder");
  Collected c;
  const auto report = record(dir.path(), recorder_options(dir.path()), {{2'000, 7, Keep::kFull}}, c);
  EXPECT_TRUE(report.whole());
  EXPECT_EQ(report.foreign, 0U);
  ASSERT_EQ(c.frames.size(), 2'000U);
  std::size_t n = 0;
  for (const auto& m : c.frame_batches) {
    EXPECT_LT(m.getEncodedSize(), 1400);
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i, ++n) {
      const auto r = frame_record(static_cast<std::int64_t>(n), 7, Keep::kFull);
      ASSERT_EQ(m.mono_ns + m.mono_offset_ns[i], r.mono_ns);
      ASSERT_EQ(m.device_us + m.device_offset_us[i], r.device_us);
      ASSERT_EQ(static_cast<std::uint32_t>(m.sequence + m.sequence_offset[i]), r.sequence);
      ASSERT_EQ(m.step, 7);
      ASSERT_EQ(m.bound_ns[i], r.bound_ns);
      ASSERT_EQ(m.repeatability_ns[i], r.repeatability_ns);
      ASSERT_EQ(m.raw_position_mm[i], r.raw_position_mm);
      ASSERT_EQ(m.raw_force_N[i], r.raw_force_N);
      ASSERT_EQ(m.position_mm[i], r.position_mm);
      ASSERT_EQ(m.force_N[i], r.force_N);
    }
  }
  n = 0;
  for (const auto& m : c.pressure_batches) {
    EXPECT_LT(m.getEncodedSize(), 1400);
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i, ++n) {
      const auto r = pressure_record(static_cast<std::int64_t>(n), 7, Keep::kFull);
      ASSERT_EQ(m.mono_ns + m.mono_offset_ns[i], r.mono_ns);
      ASSERT_EQ(m.device_us + m.device_offset_us[i], r.device_us);
      ASSERT_EQ(m.sequence + m.sequence_offset[i], r.sequence);
      ASSERT_EQ(static_cast<std::uint32_t>(m.raw_word[i]), r.raw_word);
      ASSERT_EQ(m.status[i], r.status);
      ASSERT_EQ(m.temperature_C[i], r.temperature_C);
      ASSERT_EQ(m.pressure_psi[i], r.pressure_psi);
    }
  }
  EXPECT_EQ(n, 2'000U);
  ASSERT_EQ(c.controls.size(), 200U);
  EXPECT_EQ(c.controls[1].mono_ns, 10 * kMs);
  EXPECT_EQ(c.controls[1].state, isorig_msgs::control_t::RUNNING);
  EXPECT_EQ(c.controls[0].worst_wakeup_ns, 90'000);
  ASSERT_EQ(c.exchange.size(), 8U);
  EXPECT_EQ(c.exchange[3].device, DeviceId::kPressure);
  EXPECT_EQ(c.exchange[3].exchange.host_send_ns, 500 * kMs - 300'000);
  EXPECT_EQ(c.exchange[3].exchange.device_tx_us, 500'020.25);
  ASSERT_EQ(c.events.size(), 1U);
  EXPECT_EQ(c.events[0].code, "step");
  EXPECT_EQ(c.events[0].text, "at sample 0");
  ASSERT_EQ(c.headers.size(), 1U);
  EXPECT_EQ(c.headers[0].specimen, "M1");
  EXPECT_EQ(c.headers[0].texts.at(1).text, "# rig\n");
  EXPECT_EQ(file_text(dir.path() / "inputs" / "rig.toml"), "# rig\n");
  EXPECT_THAT(file_text(dir.path() / "run.toml"), HasSubstr("specimen = 'M1'"));
}

TEST(Recorder, EverySampleIsWrittenOnceInFullRoundTheRampsAndInAveragesElsewhere) {
  const TemporaryDirectory dir("recorder");
  auto options = recorder_options(dir.path());
  options.before_s = 0.5;
  Collected c;
  EXPECT_TRUE(record(dir.path(), options, kTwoRamps, c).whole());
  const std::vector<std::pair<std::int64_t, std::int64_t>> full{{2'717 * kMs + 1, 4'751 * kMs},
                                                                {8'503 * kMs + 1, 9'777 * kMs}};
  // Each sample, by its stamp: how often it was written in full.
  std::map<std::int64_t, int> frames;
  for (const auto& s : c.frames) ++frames[s.mono_ns];
  std::map<std::int64_t, int> pressures;
  for (const auto& s : c.pressures) ++pressures[s.mono_ns];
  const auto check = [&](const auto& written, const auto& intervals, auto make, auto value) {
    auto interval = intervals.begin();
    for (std::int64_t i = 0; i < 12'500;) {
      const auto r = make(i);
      const bool is_full = due_in_full(r.mono_ns, full);
      ASSERT_EQ(written.count(r.mono_ns), is_full ? 1U : 0U) << "sample " << i;
      if (is_full) {
        ASSERT_EQ(written.at(r.mono_ns), 1);
        ++i;
        continue;
      }
      // The next interval begins exactly here, and its figures are those of its samples.
      ASSERT_NE(interval, intervals.end());
      ASSERT_EQ(interval->first_ns, r.mono_ns);
      double sum = 0.0, low = 1e9, high = -1e9;
      int current = 0;
      for (int k = 0; k < interval->samples; ++k, ++i) {
        const auto q = make(i);
        ASSERT_FALSE(due_in_full(q.mono_ns, full)) << "sample " << i << " is in an average and in full";
        ASSERT_EQ(q.mono_ns / (100 * kMs), r.mono_ns / (100 * kMs)) << "an interval crosses the grid";
        const std::optional<double> x = value(q);
        if (!x) continue;
        ++current;
        sum += *x;
        low = std::min(low, *x);
        high = std::max(high, *x);
      }
      EXPECT_EQ(interval->last_ns, make(i - 1).mono_ns);
      EXPECT_EQ(interval->mean, sum / current);
      EXPECT_EQ(interval->min, low);
      EXPECT_EQ(interval->max, high);
      ++interval;
    }
    EXPECT_EQ(interval, intervals.end());
  };
  check(
      frames, c.frame_intervals, [](std::int64_t i) { return frame_record(i, 0, Keep::kFull); },
      [](const FrameRecord& r) { return std::optional(r.position_mm); });
  check(
      pressures, c.pressure_intervals, [](std::int64_t i) { return pressure_record(i, 0, Keep::kFull); },
      [](const PressureRecord& r) { return r.status == 0 ? std::optional(r.pressure_psi) : std::nullopt; });
  EXPECT_EQ(c.marks.back().frame_full + c.marks.back().frame_averaged, 12'500);
  EXPECT_EQ(c.marks.back().frame_missing, 0);
}

TEST(Recorder, IntervalsEndWhereAStepEnds) {
  const TemporaryDirectory dir("recorder");
  Collected c;
  record(dir.path(), recorder_options(dir.path()), kTwoRamps, c);
  EXPECT_TRUE(std::any_of(c.frame_intervals.begin(), c.frame_intervals.end(), [](const auto& i) {
    return i.step == 3 && i.last_ns == frame_record(10'110, 3, Keep::kFull).mono_ns && i.samples == 11;
  }));
}

TEST(Recorder, AStopIsRecordedInFullWithItsRunUpAndWhatFollows) {
  const TemporaryDirectory dir("recorder");
  auto options = recorder_options(dir.path());
  options.before_s = 1.0;
  options.evidence_s = 0.5;
  Streams streams;
  Recorder recorder(options, run_info());
  const Stretch slow{8'000, 0, Keep::kAveraged};
  for (std::int64_t i = 0; i < slow.until_ms; ++i) {
    push_ms(streams, i, slow);
    if (i == 5'042) streams.events.push(event_record(i, 0, "limit.force", Severity::kProgramStop));
    recorder.drain(streams, i * kMs);
  }
  recorder.finish(streams, false);
  Collected c;
  EXPECT_TRUE(messages::read_run(dir.path(), c).whole());
  ASSERT_FALSE(c.frames.empty());
  EXPECT_LE(c.frames.front().mono_ns, 4'100 * kMs);
  EXPECT_EQ(c.frames.back().mono_ns, frame_record(5'541, 0, Keep::kFull).mono_ns);
  for (std::size_t i = 1; i < c.frames.size(); ++i) ASSERT_EQ(c.frames[i].mono_ns - c.frames[i - 1].mono_ns, kMs);
  std::int64_t samples = static_cast<std::int64_t>(c.frames.size());
  for (const auto& i : c.frame_intervals) samples += i.samples;
  EXPECT_EQ(samples, 8'000);
  EXPECT_EQ(c.marks.back().kind, isorig_msgs::session_mark_t::END);
  EXPECT_EQ(c.marks.back().complete, 0);
}

TEST(Recorder, EachSessionBeginsASegmentThatSaysWhatItIs) {
  const TemporaryDirectory dir("recorder");
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.0}, {2, 1, 10.0, 117.0}, {4, 2, 5.0, 118.0}};
  std::vector<SessionChange> changes;
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path()), info);
    recorder.on_session([&](const SessionChange& s) { changes.push_back(s); });
    run_plan(recorder, streams, kTwoRamps, 20);
    recorder.finish(streams, true);
  }
  Collected c;
  EXPECT_TRUE(messages::read_run(dir.path(), c).whole());
  EXPECT_EQ(c.segments, (std::vector<std::string>{"segment-0001.lcm", "segment-0002.lcm", "segment-0003.lcm"}));
  EXPECT_EQ(c.headers.size(), 3U);
  ASSERT_EQ(c.marks.size(), 6U);
  EXPECT_EQ(c.marks[2].session.pressure_psi, 10.0);
  EXPECT_EQ(c.marks[2].kind, isorig_msgs::session_mark_t::BEGIN);
  EXPECT_EQ(c.marks[3].kind, isorig_msgs::session_mark_t::END);
  EXPECT_EQ(c.marks[3].complete, 1);
  ASSERT_EQ(changes.size(), 6U);
  EXPECT_TRUE(changes[4].began);
  EXPECT_EQ(changes[4].segment, "segment-0003.lcm");
  // No sample is in the wrong session, and all are there.
  std::int64_t samples = 0;
  for (const auto& s : c.frames) {
    EXPECT_EQ(s.session, s.step >= 4 ? 2 : s.step >= 2 ? 1 : 0);
    ++samples;
  }
  for (const auto& i : c.frame_intervals) {
    EXPECT_EQ(i.session, i.step >= 4 ? 2 : i.step >= 2 ? 1 : 0);
    samples += i.samples;
  }
  EXPECT_EQ(samples, 12'500);
}

TEST(Recorder, TheSameRecordsGiveTheSameBytesHoweverTheyAreDrained) {
  const TemporaryDirectory one("recorder");
  const TemporaryDirectory two("recorder");
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.0}, {2, 1, 10.0, 117.0}, {4, 2, 5.0, 118.0}};
  Collected c;
  auto options = recorder_options(one.path());
  options.max_segment_bytes = 100'000;
  record(one.path(), options, kTwoRamps, c, 1, info);
  options.run_dir = two.path();
  record(two.path(), options, kTwoRamps, c, 3'333, info);
  const auto segments = messages::list_segments(one.path());
  ASSERT_GT(segments.size(), 3U) << "rotation by size was to be in it";
  ASSERT_EQ(segments.size(), messages::list_segments(two.path()).size());
  for (const auto& s : segments) EXPECT_TRUE(file_text(s) == file_text(two.path() / s.filename())) << s;
}

TEST(Recorder, TheLogIsOneThatLcmReadsWithTimeThatNeverRunsBackwards) {
  const TemporaryDirectory dir("recorder");
  Collected c;
  const auto report = record(dir.path(), recorder_options(dir.path()), kTwoRamps, c);
  auto* log = lcm_eventlog_create((dir.path() / "segment-0001.lcm").c_str(), "r");
  ASSERT_NE(log, nullptr);
  std::uint64_t events = 0;
  std::int64_t last = run_info().epoch_unix_us;
  while (auto* event = lcm_eventlog_read_next_event(log)) {
    EXPECT_EQ(event->eventnum, static_cast<std::int64_t>(events++));
    EXPECT_GE(event->timestamp, last);
    last = event->timestamp;
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(log);
  EXPECT_EQ(events, report.events);
  EXPECT_NEAR(static_cast<double>(last - run_info().epoch_unix_us), 12.5e6, 0.1e6);
}

TEST(Recorder, GapsInADevicesCounterAreCounted) {
  const TemporaryDirectory dir("recorder");
  Streams streams;
  Recorder recorder(recorder_options(dir.path()), run_info());
  for (std::int64_t i = 0; i < 1'000; ++i) {
    if (i < 100 || i >= 117) push_ms(streams, i, {1'000, 0, Keep::kFull});
  }
  recorder.finish(streams, true);
  EXPECT_EQ(recorder.status().frame_missing, 17U);
  EXPECT_EQ(recorder.status().pressure_missing, 17U);
}

TEST(Recorder, AQueueThatOverflowedIsAnEventInTheRecording) {
  const TemporaryDirectory dir("recorder");
  Streams streams(64);
  Recorder recorder(recorder_options(dir.path()), run_info());
  for (std::int64_t i = 0; i < 100; ++i) push_ms(streams, i, {100, 0, Keep::kFull});
  recorder.finish(streams, true);
  Collected c;
  messages::read_run(dir.path(), c);
  ASSERT_EQ(c.events.size(), 1U);
  EXPECT_EQ(c.events[0].code, "recorder.dropped");
  EXPECT_EQ(c.events[0].value, static_cast<double>(streams.dropped()));
  EXPECT_EQ(recorder.status().dropped_records, streams.dropped());
}

TEST(Recorder, WorksBesideTheLoopThatFillsItsQueuesAndThoseWhoAsk) {
  const TemporaryDirectory dir("recorder");
  auto streams = std::make_unique<Streams>();
  Recorder recorder(recorder_options(dir.path()), run_info());
  std::atomic<std::int64_t> pushed{0};
  std::atomic<bool> done{false};
  std::thread loop([&] {
    for (std::int64_t i = 0; i < 20'000; ++i) {
      push_ms(*streams, i, {0, 0, i % 4'000 < 1'000 ? Keep::kFull : Keep::kAveraged});
      pushed.store(i * kMs, std::memory_order_release);
      // The real loop has a millisecond for this; here the recorder only has to get its turn.
      while (streams->frame.size() > 20'000) std::this_thread::yield();
    }
    done = true;
  });
  std::thread asking([&] {
    while (!done) {
      EXPECT_EQ(recorder.disk(), DiskCondition::kOk);
      EXPECT_EQ(recorder.status().dropped_records, 0U);
    }
  });
  while (!done) recorder.drain(*streams, pushed.load(std::memory_order_acquire));
  loop.join();
  asking.join();
  recorder.finish(*streams, true);
  const auto status = recorder.status();
  EXPECT_EQ(status.frame_full + status.frame_averaged, 20'000U);
  EXPECT_EQ(status.pressure_full + status.pressure_averaged, 20'000U);
}

TEST(Recorder, AFurtherAttemptGoesOnBehindWhatIsThere) {
  const TemporaryDirectory dir("recorder");
  Collected c;
  record(dir.path(), recorder_options(dir.path()), {{2'000, 0, Keep::kFull}}, c);
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path()), run_info());
    EXPECT_EQ(recorder.attempt(), 2);
    EXPECT_TRUE(RunLock::is_held(dir.path()));
    EXPECT_THROW(Recorder(recorder_options(dir.path()), run_info()), std::runtime_error);
    run_plan(recorder, streams, {{3'000, 0, Keep::kFull}}, 20, 2'000);
    recorder.finish(streams, true);
  }
  EXPECT_FALSE(RunLock::is_held(dir.path()));
  Collected all;
  EXPECT_TRUE(messages::read_run(dir.path(), all).whole());
  EXPECT_EQ(all.segments.size(), 2U);
  EXPECT_EQ(all.frames.size(), 3'000U);
  EXPECT_EQ(all.marks.back().attempt, 2);
}

}  // namespace
}  // namespace isorig::daemon::testing
