#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstring>
#include <fstream>
#include <string_view>

#include "daemon/recording/run_directory.hpp"
#include "recording_rig.hpp"
#include "small_disk.hpp"

/// A disk that has become read-only under open files, as ext4 does after an error (errors=remount-ro): while this is
/// set, segments are neither made nor written nor synced, each with EROFS. (A program's own symbol comes before
/// libc's.) tests/system/failing_disk_test.cpp has a real one, which cannot be made writable again under the process.
static bool segments_read_only = false;

static bool refused(std::string_view path) {
  if (!segments_read_only || path.find("/segment-") == std::string_view::npos) return false;
  errno = EROFS;
  return true;
}

static bool refused(int fd) {
  if (!segments_read_only) return false;
  char link[64], name[512];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const auto n = ::readlink(link, name, sizeof name);
  return n > 0 && refused(std::string_view(name, static_cast<std::size_t>(n)));
}

extern "C" int open(const char* path, int flags, ...) {
  std::va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  if ((flags & O_ACCMODE) != O_RDONLY && refused(path)) return -1;
  return static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

extern "C" ssize_t write(int fd, const void* data, std::size_t size) {
  return refused(fd) ? -1 : ::syscall(SYS_write, fd, data, size);
}

extern "C" int fdatasync(int fd) {
  return refused(fd) ? -1 : static_cast<int>(::syscall(SYS_fdatasync, fd));
}

namespace isorig::daemon::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr const char* kNeedsRoot = "a disk that is remounted read-only is a tmpfs, and mounting needs root: ";

TEST(RecordingOnReadOnlyDisk, BeforeARunItsRecordingIsNotBegun) {
  const TemporaryDirectory dir("read-only");
  SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted()) GTEST_SKIP() << kNeedsRoot << std::strerror(errno);
  ASSERT_TRUE(disk.remount_read_only()) << std::strerror(errno);
  auto options = recorder_options(disk.path() / "run");
  EXPECT_THAT([&] { Recorder recorder(options, run_info()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("Read-only file system")));
  EXPECT_FALSE(std::filesystem::exists(disk.path() / "run"));
}

TEST(WhyNotWritable, SaysWhatTheDiskSaysAndLeavesNothingBehind) {
  const TemporaryDirectory dir("writable");
  const auto runs = dir.path() / "data" / "runs";
  EXPECT_EQ(why_not_writable(runs), "") << "a folder that is not there is made, as a start makes it";
  EXPECT_TRUE(std::filesystem::is_directory(runs));
  EXPECT_TRUE(std::filesystem::is_empty(runs));
  std::ofstream(dir.path() / "file") << "no folder";
  EXPECT_THAT(why_not_writable(dir.path() / "file" / "runs"), HasSubstr("Not a directory"));
  SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted()) GTEST_SKIP() << kNeedsRoot << std::strerror(errno);
  EXPECT_EQ(why_not_writable(disk.path()), "");
  disk.fill();
  EXPECT_THAT(why_not_writable(disk.path()), HasSubstr("No space left on device"));
  disk.make_room();
  EXPECT_EQ(why_not_writable(disk.path()), "");
  ASSERT_TRUE(disk.remount_read_only()) << std::strerror(errno);
  EXPECT_THAT(why_not_writable(disk.path()), HasSubstr("Read-only file system"));
  EXPECT_TRUE(std::filesystem::is_empty(disk.path()));
}

/// An operator's `mount -o remount,ro`: the kernel refuses it while a segment is open for writing.
TEST(RecordingOnReadOnlyDisk, CannotBeAskedForWhileARunIsRecorded) {
  const TemporaryDirectory dir("read-only");
  SmallDisk disk(dir.path() / "disk");
  if (!disk.mounted()) GTEST_SKIP() << kNeedsRoot << std::strerror(errno);
  auto options = recorder_options(disk.path() / "run");
  options.reserve_bytes = 100'000;
  {
    Streams streams;
    Recorder recorder(options, run_info());
    run_plan(recorder, streams, {{1'500, 0, Keep::kFull}}, 20);
    EXPECT_FALSE(disk.remount_read_only());
    EXPECT_EQ(errno, EBUSY);
    run_plan(recorder, streams, {{3'000, 0, Keep::kFull}}, 20, 1'500);
    EXPECT_EQ(recorder.disk(), DiskCondition::kOk);
    EXPECT_TRUE(recorder.finish(streams, true));
  }
  EXPECT_TRUE(disk.remount_read_only()) << "the run is closed, and something is open all the same: "
                                        << std::strerror(errno);
  Collected c;
  EXPECT_TRUE(messages::read_run(disk.path() / "run", c).whole());
  EXPECT_EQ(c.frames.size(), 3'000U);
}

TEST(RecordingOnReadOnlyDisk, InMidRunIsHeldInMemoryAndWrittenWhenItIsWritableAgain) {
  const TemporaryDirectory dir("read-only");
  auto options = recorder_options(dir.path() / "run");
  options.sync_interval_s = 0.5;
  Streams streams;
  Recorder recorder(options, run_info());
  bool complete = true;
  recorder.on_session([&](const SessionChange& c) { complete = c.began || c.complete; });
  run_plan(recorder, streams, {{2'000, 0, Keep::kFull}}, 20);
  ASSERT_EQ(recorder.disk(), DiskCondition::kOk);
  segments_read_only = true;
  run_plan(recorder, streams, {{5'000, 0, Keep::kFull}}, 20, 2'000);
  EXPECT_GE(recorder.disk(), DiskCondition::kFailing) << "which is a program stop";
  EXPECT_THAT(recorder.status().error, HasSubstr("Read-only file system"));
  EXPECT_THAT(recorder.status().fault, HasSubstr("Read-only file system"));
  EXPECT_GT(recorder.status().held_bytes, 0U);
  EXPECT_EQ(recorder.status().lost_messages, 0U);
  segments_read_only = false;
  run_plan(recorder, streams, {{7'000, 0, Keep::kFull}}, 20, 5'000);
  EXPECT_EQ(recorder.status().error, "");
  EXPECT_LT(recorder.status().held_bytes, 200'000U) << "no more than is written at a time";
  EXPECT_TRUE(recorder.finish(streams, true));
  EXPECT_EQ(recorder.status().lost_messages, 0U);
  EXPECT_THAT(recorder.status().fault, HasSubstr("Read-only file system")) << "the run cannot be called done";
  EXPECT_FALSE(complete);
  Collected c;
  const auto report = messages::read_run(dir.path() / "run", c);
  EXPECT_EQ(report.state(), messages::RecordingState::kIncomplete) << ::testing::PrintToString(report.complaints());
  EXPECT_EQ(c.segments.size(), 2U);
  ASSERT_EQ(c.frames.size(), 7'000U);
  for (std::size_t i = 0; i < c.frames.size(); ++i) {
    ASSERT_EQ(c.frames[i].mono_ns, frame_record(static_cast<std::int64_t>(i), 0, Keep::kFull).mono_ns);
  }
}

}  // namespace
}  // namespace isorig::daemon::testing
