#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>

#include "daemon/recorder.hpp"
#include "messages/log_writer.hpp"
#include "recording_rig.hpp"

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
  EXPECT_EQ(c.frames.back().mono_ns, frame_record(2'999, 0, Keep::kFull).mono_ns)
      << "reading went on behind it";
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
  const auto disk = dir.path() / "disk";
  std::filesystem::create_directory(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=2m") != 0) {
    GTEST_SKIP() << "mounting a small disk needs root: " << std::strerror(errno);
  }
  struct Unmount {
    std::filesystem::path at;
    ~Unmount() { ::umount2(at.c_str(), MNT_DETACH); }
  } unmount{disk};
  auto options = recorder_options(disk / "run");
  options.min_free_bytes = 0;
  options.reserve_bytes = 700'000;
  options.free_bytes = nullptr;
  {
    Streams streams;
    Recorder recorder(options, run_info());
    run_plan(recorder, streams, {{2'000, 0, Keep::kFull}}, 20);
    EXPECT_EQ(recorder.disk(), DiskCondition::kOk);
    const int hog = ::open((disk / "hog").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    ASSERT_GE(hog, 0);
    const std::string block(4096, 'x');
    while (::write(hog, block.data(), block.size()) > 0) {
    }
    run_plan(recorder, streams, {{4'500, 0, Keep::kFull}}, 20, 2'000);
    EXPECT_EQ(recorder.disk(), DiskCondition::kReserve);
    while (::write(hog, block.data(), block.size()) > 0) {
    }
    run_plan(recorder, streams, {{7'000, 0, Keep::kFull}}, 20, 4'500);
    EXPECT_EQ(recorder.disk(), DiskCondition::kFailing);
    EXPECT_GT(recorder.status().held_bytes, 0U);
    EXPECT_THAT(recorder.status().error, HasSubstr("No space left"));
    ::close(hog);
    std::filesystem::remove(disk / "hog");  // someone makes room: what was held is written
    recorder.finish(streams, false);
    EXPECT_EQ(recorder.status().held_bytes, 0U);
    EXPECT_EQ(recorder.status().lost_messages, 0U);
  }
  Collected c;
  EXPECT_TRUE(messages::read_run(disk / "run", c).whole());
  ASSERT_EQ(c.frames.size(), 7'000U);
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
    const std::vector<std::uint8_t> data(971, 7);  // 1000 B an event
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
