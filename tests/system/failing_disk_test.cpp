// The daemon on a disk that becomes read-only, and on a disk that hangs: ext4 on a loop device, which its own error
// handling makes read-only under open files (errors=remount-ro), as a failing disk does, or which is frozen (FIFREEZE).
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/fs.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <unistd.h>

#include <cstdlib>

#include "messages/run_log.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kReadOnly = "Read-only file system";

class LoopDisk {
 public:
  explicit LoopDisk(const TempDir& dir) : image_(dir / "image"), at_(dir / "disk"), errors_(dir / "mount.log") {
    std::filesystem::create_directory(at_);
    // Sparse, and larger than what a start wants to find free.
    mounted_ = shell("truncate -s 1G " + image_.string() + " && mkfs.ext4 -q " + image_.string()) && mount();
  }
  ~LoopDisk() {
    (void)hang(false);
    unmount();
  }
  LoopDisk(const LoopDisk&) = delete;
  LoopDisk& operator=(const LoopDisk&) = delete;

  [[nodiscard]] bool mounted() const { return mounted_; }
  [[nodiscard]] std::string why_not() const { return slurp(errors_); }
  [[nodiscard]] const std::filesystem::path& path() const { return at_; }
  /// From now on nothing is written, whoever has it open. False: this kernel does not let a test ask for it.
  [[nodiscard]] bool fail() const {
    std::ifstream mounts("/proc/mounts");
    std::string device, where, rest;
    while (mounts >> device >> where && std::getline(mounts, rest)) {
      if (where != at_) continue;
      std::ofstream trigger("/sys/fs/ext4/" + std::filesystem::path(device).filename().string() + "/trigger_fs_error");
      return static_cast<bool>(trigger << "1" << std::flush);
    }
    return false;
  }
  /// Whoever writes waits, without an answer and without an error, until this is called with false.
  [[nodiscard]] bool hang(bool yes) const {
    const int fd = ::open(at_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const bool done = fd >= 0 && ::ioctl(fd, yes ? FIFREEZE : FITHAW, 0) == 0;
    if (fd >= 0) ::close(fd);
    return done;
  }
  /// Taken off, checked and mounted again, as an operator does it.
  [[nodiscard]] bool mend() {
    unmount();
    (void)shell("e2fsck -fy " + image_.string());  // 1: errors were corrected
    return mount();
  }

 private:
  [[nodiscard]] bool shell(const std::string& command) const {
    return std::system((command + " >" + errors_.string() + " 2>&1").c_str()) == 0;
  }
  [[nodiscard]] bool mount() const {
    return shell("mount -o loop,errors=remount-ro " + image_.string() + " " + at_.string());
  }
  void unmount() const { ::umount2(at_.c_str(), 0); }

  std::filesystem::path image_, at_, errors_;
  bool mounted_ = false;
};

class FailingDisk : public testing::Test {
 protected:
  void SetUp() override {
    disk_.emplace(dir_);
    if (!disk_->mounted())
      GTEST_SKIP() << "a disk that fails is ext4 on a loop device, which needs root: " << disk_->why_not();
    std::filesystem::create_directory(disk_->path() / "runs");
    std::filesystem::create_directory_symlink(disk_->path() / "runs", dir_ / "runs");
    spit(dir_ / "slow.toml", R"(format = "isorig-protocol/1"
name = "slow"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "ramp", to_mm = 0.6, velocity_mm_s = 0.1 },
]
)");
    rig_ = patient_rig(dir_);
    daemon_.emplace(dir_, rig_);
    ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  }

  /// Whoever waits for the disk cannot be killed before it answers.
  void TearDown() override { (void)disk_->hang(false); }

  TempDir dir_;
  std::optional<LoopDisk> disk_;
  std::filesystem::path rig_;
  std::optional<DaemonProcess> daemon_;
};

constexpr const char* kNoTrigger =
    "this kernel has no /sys/fs/ext4/DEVICE/trigger_fs_error, or does not let us write it";

TEST_F(FailingDisk, ReadOnlyBeforeAStartRefusesItInWordsAndIsNotReady) {
  if (!disk_->fail()) GTEST_SKIP() << kNoTrigger;
  for (const bool began_on_it : {false, true}) {  // the daemon, too
    if (began_on_it) {
      EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
      daemon_.emplace(dir_, rig_);
    } else {
      // Before the daemon has looked.
      const auto answer = daemon_->call({"start", (dir_ / "slow.toml").string()});
      EXPECT_NE(answer.code, 0);
      EXPECT_THAT(answer.text, AllOf(HasSubstr(kReadOnly), HasSubstr("nothing was started")));
    }
    // Looked at every 30 s.
    ASSERT_TRUE(wait_until(60.0, [&] {
      const auto status = daemon_->status();  // nothing, until the daemon answers
      return status.is_object() && status.value("not_ready", "").find(kReadOnly) != std::string::npos;
    })) << daemon_->log();
    EXPECT_EQ(daemon_->state(), "idle") << daemon_->log();
    EXPECT_THAT(daemon_->log(), HasSubstr("no run could be recorded in " + (dir_ / "runs").string()));
    EXPECT_THAT(daemon_->log(), Not(HasSubstr("No such file or directory")));
    const auto answer = daemon_->call({"start", (dir_ / "slow.toml").string()});
    EXPECT_NE(answer.code, 0);
    EXPECT_THAT(answer.text, AllOf(HasSubstr(kReadOnly), HasSubstr("the rig is idle")));
    EXPECT_EQ(daemon_->catalogue().size(), 0U);
  }
}

struct Frames : messages::RunVisitor {
  std::int64_t last_ns = 0;
  std::size_t count = 0;
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) last_ns = m.mono_ns + m.mono_offset_ns[i];
    count += static_cast<std::size_t>(m.count);
  }
};

/// A write waits for ever in the kernel; status, events and verbs do not, and the loop ticks.
TEST_F(FailingDisk, HangingBeforeAStartIsNotReadyAndHoldsUpNobody) {
  ASSERT_TRUE(disk_->hang(true));
  ASSERT_TRUE(daemon_->reach("idle", 90.0)) << daemon_->log();  // looked at every 30 s, with 10 s for an answer
  EXPECT_EQ(daemon_->status().value("not_ready", ""), "no run could be recorded: the disk has not answered for 10 s");
  EXPECT_THAT(daemon_->log(), HasSubstr("no run could be recorded in " + (dir_ / "runs").string()));
  const auto refused = daemon_->call({"start", (dir_ / "slow.toml").string()}, 20.0);
  EXPECT_NE(refused.code, 0) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("the disk has not answered for 10 s"));
  const auto ticks = daemon_->status()["loop"].value("ticks", 0);
  ASSERT_TRUE(wait_until(60.0, [&] { return daemon_->status()["loop"].value("ticks", 0) > ticks + 12'000; }));
  EXPECT_EQ(daemon_->state(), "idle") << "a recorder without turns would be a program stop";

  ASSERT_TRUE(disk_->hang(false));
  ASSERT_TRUE(daemon_->reach("ready", 30.0)) << daemon_->log();
  const auto id = started_run(daemon_->call({"start", (dir_ / "slow.toml").string()}));
  EXPECT_EQ(daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 120.0).code, 0) << daemon_->log();
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
  Frames frames;
  EXPECT_TRUE(messages::read_run(dir_ / "runs" / id, frames).whole());
}

/// A thread of it may still wait in the kernel, until the disk answers.
bool has_left(pid_t pid) {
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  std::stringstream text;
  text << status.rdbuf();
  return !status || text.str().find("State:\tZ") != std::string::npos;
}

/// Nothing was left to write: no answer is awaited, whether the daemon had noticed before or not.
TEST_F(FailingDisk, HangingBetweenRunsKeepsNobodyFromLeaving) {
  for (const bool noticed : {false, true}) {
    if (noticed) {
      daemon_.emplace(dir_, rig_);
      ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
    }
    ASSERT_TRUE(disk_->hang(true));
    if (noticed) {
      ASSERT_TRUE(daemon_->reach("idle", 90.0)) << daemon_->log();
    }
    const pid_t pid = daemon_->process().pid();
    ASSERT_EQ(::kill(pid, SIGTERM), 0);
    EXPECT_TRUE(wait_until(20.0, [&] { return has_left(pid); })) << daemon_->log();
    EXPECT_THAT(daemon_->log(), HasSubstr("at rest"));
    ASSERT_TRUE(disk_->hang(false));
    EXPECT_EQ(daemon_->process().wait(20.0), 0) << daemon_->log();
  }
}

/// The end of a run is written before the daemon leaves; a second signal does without.
TEST_F(FailingDisk, HangingInMidRunIsWaitedForAfterOneSignalAndNotAfterTwo) {
  const auto id = started_run(daemon_->call({"start", (dir_ / "slow.toml").string()}));
  ASSERT_TRUE(wait_until(60.0, [&] { return daemon_->status().value("position_mm", 0.0) > 0.1; })) << daemon_->log();
  ASSERT_TRUE(disk_->hang(true));
  const pid_t pid = daemon_->process().pid();
  ASSERT_EQ(::kill(pid, SIGTERM), 0);
  ASSERT_TRUE(wait_until(60.0, [&] { return daemon_->log().find("at rest") != std::string::npos; })) << daemon_->log();
  EXPECT_FALSE(wait_until(3.0, [&] { return has_left(pid); })) << "the disk might still answer";
  ASSERT_EQ(::kill(pid, SIGTERM), 0);
  EXPECT_TRUE(wait_until(20.0, [&] { return has_left(pid); })) << daemon_->log();
  ASSERT_TRUE(disk_->hang(false));
  EXPECT_EQ(daemon_->process().wait(20.0), 1) << "not everything was written";
  daemon_.reset();

  daemon_.emplace(dir_, rig_);
  ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  EXPECT_EQ(daemon_->catalogue()[0].value("state", ""), "interrupted");
  EXPECT_EQ(daemon_->catalogue()[0].value("id", ""), id);
}

TEST_F(FailingDisk, ReadOnlyInMidRunIsAProgramStopAndTheRunGoesOnWhenTheDiskIsMended) {
  const auto id = started_run(daemon_->call({"start", (dir_ / "slow.toml").string()}));
  ASSERT_TRUE(wait_until(60.0, [&] { return daemon_->status().value("position_mm", 0.0) > 0.2; })) << daemon_->log();
  const auto before = daemon_->status();
  if (!disk_->fail()) GTEST_SKIP() << kNoTrigger;
  ASSERT_TRUE(daemon_->reach("faulted", 30.0)) << daemon_->status().dump(2);
  auto status = daemon_->status();
  EXPECT_THAT(status.value("fault", ""), HasSubstr("the recording cannot be continued"));
  EXPECT_THAT(status["recorder"].value("error", ""), HasSubstr(kReadOnly));
  EXPECT_THAT(daemon_->log(), HasSubstr(kReadOnly));
  EXPECT_EQ(status["recorder"].value("lost_messages", -1), 0) << status.dump(2);
  EXPECT_GT(status.value("pressure_psi", 0.0), 4.0) << "a program stop holds the pressure";
  const auto ticks = status["loop"].value("ticks", 0);
  EXPECT_TRUE(wait_until(10.0, [&] { return daemon_->status()["loop"].value("ticks", 0) > ticks + 500; }));
  EXPECT_NE(daemon_->call({"reset"}).code, 0) << "the cause is still there";

  // The orderly way out: at rest first, then it says that not everything could be written.
  EXPECT_EQ(daemon_->process().stop(SIGTERM, 60.0), 1) << daemon_->log();
  EXPECT_THAT(daemon_->log(), HasSubstr("at rest"));
  daemon_.reset();

  // What was on the disk a sync before it failed is there, without damage.
  ASSERT_TRUE(disk_->mend()) << disk_->why_not();
  Frames frames;
  const auto report = messages::read_run(dir_ / "runs" / id, frames);
  EXPECT_EQ(report.state(), messages::RecordingState::kInterrupted) << testing::PrintToString(report.complaints());
  EXPECT_GT(frames.count, 0U);
  constexpr std::int64_t kSyncedWithinNs = 1'350'000'000;  // docs/data.md, what a crash costs
  EXPECT_GT(frames.last_ns, before.value("mono_ns", std::int64_t{0}) - kSyncedWithinNs);

  daemon_.emplace(dir_, rig_);
  ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  EXPECT_EQ(daemon_->catalogue()[0].value("state", ""), "interrupted");
  const auto resumed = daemon_->call({"resume", id});
  ASSERT_EQ(resumed.code, 0) << resumed.text;
  EXPECT_EQ(daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 120.0).code, 0) << daemon_->log();
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
  Frames all;
  const auto whole = messages::read_run(dir_ / "runs" / id, all);
  EXPECT_TRUE(whole.whole()) << testing::PrintToString(whole.complaints());
}

}  // namespace
}  // namespace isorig::system_test
