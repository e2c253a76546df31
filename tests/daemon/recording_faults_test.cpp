#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <set>

#include "daemon/recording/recorder.hpp"
#include "daemon/recording/run_directory.hpp"
#include "messages/log_writer.hpp"
#include "recording_rig.hpp"
#include "small_disk.hpp"

/// A disk that fails: a segment's fdatasync gives EIO once for each name that is set here, everything else goes on to
/// the kernel. (A program's own symbol comes before libc's.)
static std::set<std::string> failing_syncs;  // names of files
static std::vector<std::string> syncs;       // names of segments, as they were synced

extern "C" int fdatasync(int fd) {
  char link[64], name[512];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const auto n = ::readlink(link, name, sizeof name);
  const auto file =
      std::filesystem::path(std::string(name, n > 0 ? static_cast<std::size_t>(n) : 0)).filename().string();
  if (file.starts_with("segment-")) syncs.push_back(file);
  if (failing_syncs.erase(file) > 0) {
    errno = EIO;
    return -1;
  }
  return static_cast<int>(::syscall(SYS_fdatasync, fd));
}

/// Crashes, torn files, full disks.
namespace isorig::daemon::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

const std::vector<Stretch> kFull{{3'000, 0, Keep::kFull}};

void record(const RecorderOptions& options) {
  Streams streams;
  Recorder recorder(options, run_info());
  run_plan(recorder, streams, kFull, 20);
  recorder.finish(streams, true);
}

TEST(RecordingFaults, ATornTailIsCutAndCounted) {
  const TemporaryDirectory dir("faults");
  record(recorder_options(dir.path()));
  const auto segment = dir.path() / "segment-0001.lcm";
  const auto whole_size = std::filesystem::file_size(segment);
  Collected whole;
  messages::read_run(dir.path(), whole);
  for (const std::uintmax_t cut : {1U, 13U, 28U, 200U, 5'000U}) {
    std::filesystem::resize_file(segment, whole_size - cut);
    Collected c;
    const auto report = messages::read_run(dir.path(), c);
    ASSERT_EQ(report.damage.size(), 1U);
    EXPECT_TRUE(report.damage[0].at_end);
    EXPECT_EQ(report.damage[0].offset + report.damage[0].bytes, whole_size - cut);
    EXPECT_FALSE(report.whole());
    ASSERT_LE(c.frames.size(), whole.frames.size());
    EXPECT_GE(c.frames.size() + 200, whole.frames.size());
    for (std::size_t i = 0; i < c.frames.size(); ++i) ASSERT_EQ(c.frames[i].mono_ns, whole.frames[i].mono_ns);
  }
}

TEST(RecordingFaults, DamageInTheMiddleIsSkippedAndTheLossCounted) {
  const TemporaryDirectory dir("faults");
  record(recorder_options(dir.path()));
  const auto segment = dir.path() / "segment-0001.lcm";
  {
    std::fstream f(segment, std::ios::binary | std::ios::in | std::ios::out);
    f.seekp(100'000);
    const std::string zeros(4096, '\0');  // a block that the disk lost
    f.write(zeros.data(), static_cast<std::streamsize>(zeros.size()));
  }
  Collected c;
  const auto report = messages::read_run(dir.path(), c);
  ASSERT_FALSE(report.damage.empty());
  EXPECT_FALSE(report.damage[0].at_end);
  std::uint64_t missing = 0;
  for (const auto n : report.missing) missing += n;
  EXPECT_GT(missing + report.undecodable, 0U);
  EXPECT_EQ(c.frames.back().mono_ns, frame_record(2'999, 0, Keep::kFull).mono_ns) << "reading went on behind it";
}

TEST(RecordingFaults, APipeInTheRunsFolderIsRefusedAndNotWaitedFor) {
  const TemporaryDirectory dir("faults");
  record(recorder_options(dir.path()));
  std::filesystem::rename(dir.path() / "segment-0001.lcm", dir.path() / "aside");
  ASSERT_EQ(::mkfifo((dir.path() / "segment-0001.lcm").c_str(), 0600), 0);
  Collected c;
  EXPECT_THAT([&] { messages::read_run(dir.path(), c); },
              ThrowsMessage<std::runtime_error>(HasSubstr("segment-0001.lcm is a pipe and no file")));
}

TEST(RecordingFaults, AKilledWriterLeavesEverythingUpToItsLastSync) {
  const TemporaryDirectory dir("faults");
  auto options = recorder_options(dir.path());
  options.sync_interval_s = 0.5;
  int pipe_fd[2];
  ASSERT_EQ(::pipe(pipe_fd), 0);
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    Streams streams;
    Recorder recorder(options, run_info());
    for (std::int64_t i = 0;; ++i) {  // until it is killed in the middle of it
      push_ms(streams, i, {0, 0, Keep::kFull});
      recorder.drain(streams, i * kMs);
      if (i % 1'000 == 0) {
        const auto synced = recorder.status().synced_until_ns;
        if (::write(pipe_fd[1], &synced, sizeof synced) != sizeof synced) ::_exit(1);
      }
    }
  }
  ::close(pipe_fd[1]);
  std::int64_t synced_ns = 0;
  for (int i = 0; i < 20; ++i) ASSERT_EQ(::read(pipe_fd[0], &synced_ns, sizeof synced_ns), 8);
  ASSERT_EQ(::kill(child, SIGKILL), 0);
  int state = 0;
  ASSERT_EQ(::waitpid(child, &state, 0), child);
  ASSERT_TRUE(WIFSIGNALED(state));
  ::close(pipe_fd[0]);
  EXPECT_GT(synced_ns, 17'000 * kMs);
  Collected c;
  messages::read_run(dir.path(), c);
  ASSERT_FALSE(c.frames.empty());
  EXPECT_GE(c.frames.back().mono_ns, synced_ns - kMs);
  for (std::size_t i = 0; i < c.frames.size(); ++i) {
    ASSERT_EQ(c.frames[i].mono_ns, frame_record(static_cast<std::int64_t>(i), 0, Keep::kFull).mono_ns);
  }
  EXPECT_FALSE(RunLock::is_held(dir.path()));
}

TEST(RecordingFaults, TooLittleSpaceRefusesToStartAndStopsInTime) {
  const TemporaryDirectory dir("faults");
  auto options = recorder_options(dir.path() / "a");
  options.min_free_bytes = std::uint64_t{100} << 20U;
  std::uint64_t free = std::uint64_t{99} << 20U;
  options.free_bytes = [&](const std::filesystem::path&) { return free; };
  EXPECT_THAT([&] { Recorder refused(options, run_info()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("99 MB free")));
  free = std::uint64_t{101} << 20U;
  Streams streams;
  Recorder recorder(options, run_info());
  run_plan(recorder, streams, {{2'000, 0, Keep::kFull}}, 20);
  EXPECT_EQ(recorder.disk(), DiskCondition::kOk);
  free = std::uint64_t{98} << 20U;
  run_plan(recorder, streams, {{4'000, 0, Keep::kFull}}, 20, 2'000);
  EXPECT_EQ(recorder.disk(), DiskCondition::kLow);
  recorder.finish(streams, false);
  Collected c;
  EXPECT_TRUE(messages::read_run(dir.path() / "a", c).whole());
  EXPECT_EQ(c.frames.size(), 4'000U);
}

/// A real full disk: a tmpfs of 2 MiB. Someone else fills it; the reserve takes what the stop still records.
TEST(RecordingFaults, AFullDiskLosesNothing) {
  const TemporaryDirectory dir("faults");
  SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted())
    GTEST_SKIP() << "a real full disk is a tmpfs of 2 MiB, and mounting needs root: " << std::strerror(errno);
  auto options = recorder_options(disk.path() / "run");
  options.min_free_bytes = 0;
  options.reserve_bytes = 700'000;
  options.free_bytes = nullptr;
  {
    Streams streams;
    Recorder recorder(options, run_info());
    run_plan(recorder, streams, {{2'000, 0, Keep::kFull}}, 20);
    EXPECT_EQ(recorder.disk(), DiskCondition::kOk);
    disk.fill();
    run_plan(recorder, streams, {{4'500, 0, Keep::kFull}}, 20, 2'000);
    EXPECT_EQ(recorder.disk(), DiskCondition::kReserve);
    disk.fill();
    run_plan(recorder, streams, {{7'000, 0, Keep::kFull}}, 20, 4'500);
    EXPECT_EQ(recorder.disk(), DiskCondition::kFailing);
    EXPECT_GT(recorder.status().held_bytes, 0U);
    EXPECT_THAT(recorder.status().error, HasSubstr("No space left"));
    disk.make_room();  // what was held is written
    recorder.finish(streams, false);
    EXPECT_EQ(recorder.status().held_bytes, 0U);
    EXPECT_EQ(recorder.status().lost_messages, 0U);
  }
  Collected c;
  EXPECT_TRUE(messages::read_run(disk.path() / "run", c).whole());
  ASSERT_EQ(c.frames.size(), 7'000U);
}

RunInfo two_sessions() {
  auto info = run_info();
  info.sessions = {{0, 1, 5.0, 118.0}, {2, 1, 10.0, 117.0}};
  return info;
}

TEST(RecordingFaults, ASessionIsToldAsDoneOnlyAfterItsSegmentWasSynced) {
  const TemporaryDirectory dir("faults");
  Streams streams;
  Recorder recorder(recorder_options(dir.path()), two_sessions());
  std::vector<std::string> told;
  syncs.clear();
  recorder.on_session([&](const SessionChange& c) {
    if (c.began) return;
    // What a power cut at this moment would leave: the file as it was synced last, which is now.
    Collected on_disk;
    messages::read_run(dir.path(), on_disk);
    EXPECT_TRUE(std::any_of(
        on_disk.marks.begin(), on_disk.marks.end(),
        [&](const auto& m) { return m.kind == isorig_msgs::session_mark_t::END && m.session.session == c.session; }))
        << "session " << c.session << " is told, and its end is not written";
    EXPECT_FALSE(syncs.empty());
    syncs.clear();
    told.push_back(std::to_string(c.session) + (c.complete ? " done" : " not"));
  });
  run_plan(recorder, streams, {{1'500, 0, Keep::kFull}, {3'000, 2, Keep::kFull}}, 20);
  EXPECT_TRUE(recorder.finish(streams, true));
  EXPECT_EQ(told, (std::vector<std::string>{"0 done", "1 done"}));
}

TEST(RecordingFaults, AFailedSyncIsFinalAndTheRecordingGoesOnElsewhere) {
  const TemporaryDirectory dir("faults");
  Streams streams;
  auto options = recorder_options(dir.path());
  options.sync_interval_s = 0.5;
  Recorder recorder(options, two_sessions());
  std::vector<bool> complete;
  recorder.on_session([&](const SessionChange& c) {
    if (!c.began) complete.push_back(c.complete);
  });
  run_plan(recorder, streams, {{1'500, 0, Keep::kFull}}, 20);
  failing_syncs.insert("segment-0001.lcm");  // once: the next one would "succeed"
  run_plan(recorder, streams, {{3'000, 1, Keep::kFull}, {4'000, 2, Keep::kFull}}, 20, 1'500);
  EXPECT_EQ(recorder.disk(), DiskCondition::kUnvouched);
  EXPECT_THAT(recorder.status().fault, HasSubstr("Input/output error"));
  EXPECT_TRUE(recorder.finish(streams, true)) << "what came later is on the disk";
  EXPECT_EQ(recorder.disk(), DiskCondition::kUnvouched);
  EXPECT_THAT(recorder.status().fault, HasSubstr("Input/output error"));
  EXPECT_EQ(complete, (std::vector<bool>{false, true}));
  Collected c;
  const auto report = messages::read_run(dir.path(), c);
  EXPECT_EQ(report.state(), messages::RecordingState::kIncomplete) << ::testing::PrintToString(report.complaints());
  EXPECT_EQ(c.segments.size(), 3U);
  EXPECT_EQ(c.frames.size(), 4'000U);
  EXPECT_TRUE(std::any_of(c.events.begin(), c.events.end(), [](const auto& e) { return e.code == "recorder.disk"; }));
}

TEST(RecordingFaults, AFailedSyncAtTheVeryEndIsNotDone) {
  const TemporaryDirectory dir("faults");
  Streams streams;
  Recorder recorder(recorder_options(dir.path()), run_info());
  bool complete = true;
  recorder.on_session([&](const SessionChange& c) { complete = c.began || c.complete; });
  run_plan(recorder, streams, kFull, 20);
  failing_syncs.insert("segment-0001.lcm");
  recorder.finish(streams, true);
  EXPECT_FALSE(complete);
  EXPECT_THAT(recorder.status().fault, HasSubstr("Input/output error"));
  Collected c;
  EXPECT_FALSE(messages::read_run(dir.path(), c).whole());
  EXPECT_EQ(c.frames.size(), 3'000U);
}

TEST(RecordingFaults, AFullDiskAtTheVeryEndIsNotDoneUntilThereIsRoom) {
  const TemporaryDirectory dir("faults");
  SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted())
    GTEST_SKIP() << "a real full disk is a tmpfs of 2 MiB, and mounting needs root: " << std::strerror(errno);
  auto options = recorder_options(disk.path() / "run");
  options.min_free_bytes = 0;
  options.reserve_bytes = 0;
  options.free_bytes = nullptr;
  Streams streams;
  Recorder recorder(options, run_info());
  bool complete = false;
  recorder.on_session([&](const SessionChange& c) { complete = !c.began && c.complete; });
  run_plan(recorder, streams, kFull, 20);
  disk.fill();
  EXPECT_FALSE(recorder.finish(streams, true));
  EXPECT_FALSE(complete);
  EXPECT_THAT(recorder.status().fault, HasSubstr("No space left"));
  EXPECT_FALSE(recorder.settle());
  disk.make_room();
  EXPECT_TRUE(recorder.settle());
  EXPECT_TRUE(complete);
  EXPECT_EQ(recorder.status().fault, "");
  Collected c;
  EXPECT_EQ(messages::read_run(disk.path() / "run", c).state(), messages::RecordingState::kWhole);
}

TEST(RecordingFaults, ARemovedFolderIsACondition) {
  const TemporaryDirectory dir("faults");
  auto options = recorder_options(dir.path() / "run");
  options.free_bytes = nullptr;
  Streams streams;
  Recorder recorder(options, run_info());
  run_plan(recorder, streams, {{1'500, 0, Keep::kFull}}, 20);
  std::filesystem::remove_all(dir.path() / "run");
  run_plan(recorder, streams, {{4'000, 0, Keep::kFull}}, 20, 1'500);
  EXPECT_GE(recorder.disk(), DiskCondition::kFailing);
  EXPECT_THAT(recorder.status().fault, HasSubstr("was removed"));
  EXPECT_GT(recorder.status().held_bytes, 0U);
  std::filesystem::create_directory(dir.path() / "run");  // it is back: what was held is written
  EXPECT_TRUE(recorder.finish(streams, true));
  EXPECT_EQ(recorder.status().held_bytes, 0U);
  EXPECT_NE(recorder.status().fault, "");
  Collected c;
  EXPECT_EQ(messages::read_run(dir.path() / "run", c).state(), messages::RecordingState::kDamaged);
  EXPECT_GT(c.frames.size(), 1'000U);
}

TEST(RecordingFaults, WhatTheQueuesDroppedIsMarkedAndTheSessionNotComplete) {
  const TemporaryDirectory dir("faults");
  Streams streams(1'000);
  auto options = recorder_options(dir.path());
  for (std::int64_t i = 0; i < 2'000; ++i) streams.pressure.push(pressure_record(i, 0, Keep::kFull));
  options.dropped_before = streams.dropped();  // an earlier run's, or nobody's
  ASSERT_GT(options.dropped_before, 0U);
  PressureRecord none;
  while (streams.pressure.pop(none)) {
  }
  Recorder recorder(options, two_sessions());
  std::vector<bool> complete;
  recorder.on_session([&](const SessionChange& c) {
    if (!c.began) complete.push_back(c.complete);
  });
  run_plan(recorder, streams, {{1'000, 0, Keep::kFull}}, 20);
  EXPECT_EQ(recorder.status().fault, "");
  for (std::int64_t i = 1'000; i < 5'000; ++i) push_ms(streams, i, {5'000, 0, Keep::kFull});  // nobody drains
  run_plan(recorder, streams, {{7'000, 0, Keep::kFull}, {8'000, 2, Keep::kFull}}, 20, 5'000);
  EXPECT_TRUE(recorder.finish(streams, true));
  EXPECT_EQ(recorder.last_turn_ns(), 7'980 * kMs);
  EXPECT_THAT(recorder.status().fault, HasSubstr("records were dropped"));
  EXPECT_EQ(complete, (std::vector<bool>{false, true}));
  Collected c;
  const auto report = messages::read_run(dir.path(), c);
  EXPECT_EQ(report.state(), messages::RecordingState::kIncomplete) << ::testing::PrintToString(report.complaints());
  EXPECT_EQ(report.dropped_records, streams.dropped() - options.dropped_before);
  double marked = 0.0;
  std::size_t marks = 0;
  for (const auto& e : c.events) {
    if (e.code != "recorder.dropped") continue;
    marked += e.value;
    ++marks;
  }
  EXPECT_EQ(marked, static_cast<double>(report.dropped_records));
  EXPECT_LE(marks, 3U) << "once a second, and not once a slice";
}

/// A file that cannot grow (RLIMIT_FSIZE): writes come back short, then fail. Whole events stay whole.
TEST(RecordingFaults, AShortWriteLosesAndTearsNothing) {
  const TemporaryDirectory dir("faults");
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit small{50'001, RLIM_INFINITY};
    messages::LogWriter log(dir.path() / "segment-0001.lcm", {});
    ::setrlimit(RLIMIT_FSIZE, &small);
    const std::vector<std::uint8_t> data(1'000, 7);
    for (int i = 0; i < 100; ++i) log.append("X", i, data);
    if (log.flush() || log.error().find("File too large") == std::string::npos) ::_exit(1);
    if (log.held_bytes() + 50'001 != log.size_bytes()) ::_exit(2);
    const rlimit none{RLIM_INFINITY, RLIM_INFINITY};
    ::setrlimit(RLIMIT_FSIZE, &none);
    ::_exit(log.sync() && log.held_bytes() == 0 && log.lost_events() == 0 ? 0 : 3);
  }
  int state = 0;
  ASSERT_EQ(::waitpid(child, &state, 0), child);
  ASSERT_TRUE(WIFEXITED(state));
  EXPECT_EQ(WEXITSTATUS(state), 0);
  messages::LogReader reader(dir.path() / "segment-0001.lcm");
  std::int64_t n = 0;
  while (const auto event = reader.next()) EXPECT_EQ(event->number, n++);
  EXPECT_EQ(n, 100);
  EXPECT_TRUE(reader.damage().empty());
}

TEST(RecordingFaults, WhenMemoryIsUsedUpTheLossIsCounted) {
  const TemporaryDirectory dir("faults");
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    messages::LogWriter::Options o;
    o.write_bytes = 1'000;
    o.max_held_bytes = 20'000;
    messages::LogWriter log(dir.path() / "segment-0001.lcm", o);
    const rlimit none{0, RLIM_INFINITY};
    ::setrlimit(RLIMIT_FSIZE, &none);
    const std::vector<std::uint8_t> data(967, 7);  // 1000 B an event
    int taken = 0;
    for (int i = 0; i < 100; ++i) taken += log.append("X", i, data) ? 1 : 0;
    ::_exit(taken == 20 && log.lost_events() == 80 ? 0 : 1);
  }
  int state = 0;
  ASSERT_EQ(::waitpid(child, &state, 0), child);
  ASSERT_TRUE(WIFEXITED(state));
  EXPECT_EQ(WEXITSTATUS(state), 0);
}

}  // namespace
}  // namespace isorig::daemon::testing
