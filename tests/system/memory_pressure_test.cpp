// The daemon in a memory cgroup that a neighbour keeps at its limit: the kernel takes back what it can, over and over.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/statfs.h>

#include <cerrno>
#include <cstring>

#include "messages/run_log.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

constexpr std::uint64_t kMiB = std::uint64_t{1} << 20U;
/// What the neighbour holds besides the page cache, and what is left for that.
constexpr std::uint64_t kHeld = 8 * kMiB;
constexpr std::uint64_t kRoom = 24 * kMiB;

/// Of either version; it is gone with this.
class MemoryCgroup {
 public:
  MemoryCgroup() {
    struct statfs s {};
    const std::filesystem::path root = "/sys/fs/cgroup";
    v2_ = ::statfs(root.c_str(), &s) == 0 && s.f_type == CGROUP2_SUPER_MAGIC;
    if (v2_) (void)put(root / "cgroup.subtree_control", "+memory");
    path_ = (v2_ ? root : root / "memory") / ("isorig-test-" + std::to_string(::getpid()));
    if (::mkdir(path_.c_str(), 0755) != 0) {
      why_not_ = path_.string() + ": " + std::strerror(errno);
    } else if (!std::filesystem::exists(limit_file())) {
      why_not_ = limit_file().string() + " is not there: no memory controller";
    }
  }
  ~MemoryCgroup() { ::rmdir(path_.c_str()); }
  MemoryCgroup(const MemoryCgroup&) = delete;
  MemoryCgroup& operator=(const MemoryCgroup&) = delete;

  [[nodiscard]] bool made() const { return why_not_.empty(); }
  [[nodiscard]] const std::string& why_not() const { return why_not_; }
  /// In a child: it, and all that it will hold.
  void join() const {
    if (!put(path_ / "cgroup.procs", "0")) ::_exit(125);
  }
  [[nodiscard]] bool limit(std::uint64_t bytes) const { return put(limit_file(), std::to_string(bytes)); }
  /// How often somebody wanted more.
  [[nodiscard]] std::uint64_t at_the_limit() const {
    if (!v2_) return std::stoull(slurp(path_ / "memory.failcnt"));
    const auto events = slurp(path_ / "memory.events");
    return std::stoull(events.substr(events.find("\nmax ") + 5));
  }

 private:
  [[nodiscard]] std::filesystem::path limit_file() const {
    return path_ / (v2_ ? "memory.max" : "memory.limit_in_bytes");
  }
  [[nodiscard]] static bool put(const std::filesystem::path& file, const std::string& text) {
    std::ofstream out(file);
    return static_cast<bool>(out << text << std::flush);
  }

  std::filesystem::path path_;
  std::string why_not_;
  bool v2_ = false;
};

/// Writes and reads a file that is larger than the group, and touches what it holds. Never returns.
[[noreturn]] void fill_and_touch() {
  // Not in /tmp: where that is memory, it cannot be taken back.
  std::string name = "/var/tmp/isorig-pressure-XXXXXX";
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) ::_exit(124);
  ::unlink(name.c_str());
  std::vector<char> block(kMiB), held(kHeld);
  for (char turn = 0;; ++turn) {
    for (const bool writes : {true, false}) {
      for (off_t at = 0; at < static_cast<off_t>(200 * kMiB); at += static_cast<off_t>(kMiB)) {
        const auto n =
            writes ? ::pwrite(fd, block.data(), block.size(), at) : ::pread(fd, block.data(), block.size(), at);
        if (n < 0) ::_exit(123);
        if (at % static_cast<off_t>(16 * kMiB) == 0) std::ranges::fill(held, turn);
      }
    }
  }
}

std::uint64_t resident_bytes(pid_t pid) {
  const auto status = slurp("/proc/" + std::to_string(pid) + "/status");
  return 1024 * std::stoull(status.substr(status.find("VmRSS:") + 6));
}

/// Pages that had to be read from a disk, by all its threads.
std::uint64_t major_faults(pid_t pid) {
  const auto stat = slurp("/proc/" + std::to_string(pid) + "/stat");
  std::istringstream rest(stat.substr(stat.rfind(')') + 2));
  std::string field;
  for (int i = 3; i < 12; ++i) rest >> field;  // proc(5): the state is field 3, majflt 12
  std::uint64_t faults = 0;
  rest >> faults;
  return faults;
}

TEST(MemoryPressure, CostsNeitherSamplesNorTheRun) {
  const TempDir dir;
  const MemoryCgroup group;
  if (!group.made()) GTEST_SKIP() << "a memory cgroup of its own needs root and cgroups: " << group.why_not();
  spit(dir / "slow.toml", R"(format = "isorig-protocol/1"
name = "slow"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 0.1 },
]
)");
  DaemonProcess daemon(dir, patient_rig(dir), [&] { group.join(); });
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto locked = slurp("/proc/" + std::to_string(daemon.process().pid()) + "/status");
  if (locked.find("VmLck:\t       0 kB") != std::string::npos)
    GTEST_SKIP() << "the daemon may not lock its memory: ulimit -l unlimited";
  const std::uint64_t limit = resident_bytes(daemon.process().pid()) + kRoom;
  ASSERT_TRUE(group.limit(limit));
  Process neighbour({"neighbour"}, dir / "neighbour.log", [&] {
    group.join();
    fill_and_touch();
  });
  ASSERT_TRUE(wait_until(60.0, [&] { return group.at_the_limit() > 0; }));

  const auto before = group.at_the_limit();
  const auto faults_before = major_faults(daemon.process().pid());
  const auto id = started_run(daemon.call({"start", (dir / "slow.toml").string()}));
  EXPECT_EQ(daemon.call({"watch", "--until-done", "--interval-s", "1"}, 120.0).code, 0) << daemon.log();
  const auto pressed = group.at_the_limit() - before;
  const auto faults = major_faults(daemon.process().pid()) - faults_before;
  const auto status = daemon.status();
  EXPECT_TRUE(neighbour.running()) << "it ended by itself: " << neighbour.wait(0.1);
  EXPECT_GT(pressed, 1'000U) << "in " << limit / kMiB << " MiB";
  EXPECT_EQ(faults, 0U) << "all that the daemon needs is locked";
  EXPECT_EQ(status["frame"].value("lost", -1), 0) << status.dump(2);
  EXPECT_EQ(status["pressure"].value("lost", -1), 0) << status.dump(2);
  EXPECT_EQ(daemon.catalogue()[0].value("state", ""), "done");
  messages::RunVisitor nothing;
  const auto report = messages::read_run(dir / "runs" / id, nothing);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
  RecordProperty("times_at_the_limit", std::to_string(pressed));
  neighbour.stop(SIGKILL);
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

}  // namespace
}  // namespace isorig::system_test
