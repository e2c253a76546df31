// The contract of the real-time threads (docs/threads.md), proved on the daemon itself: while a protocol runs over real
// lines, the loop and the devices' threads neither allocate nor free, lock, touch a file, throw, nor sleep but up to
// their next turn. call_watch.cpp, preloaded, writes down what does; first it has to see what is done on purpose.
#include <gtest/gtest.h>
#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <set>
#include <sstream>

#include "call_watch.hpp"
#include "wire_rig.hpp"

namespace isorig::system_test {
namespace {

/// The file that the watched program maps as well.
class SharedWatch {
 public:
  explicit SharedWatch(std::filesystem::path path) : path_(std::move(path)) {
    spit(path_, std::string(sizeof(CallWatch), '\0'));
    const int fd = ::open(path_.c_str(), O_RDWR | O_CLOEXEC);
    shared_ = ::mmap(nullptr, sizeof(CallWatch), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    ::close(fd);
    if (shared_ == MAP_FAILED) throw std::runtime_error("no memory to share");
  }
  ~SharedWatch() { ::munmap(shared_, sizeof(CallWatch)); }
  SharedWatch(const SharedWatch&) = delete;
  SharedWatch& operator=(const SharedWatch&) = delete;

  CallWatch* operator->() const { return static_cast<CallWatch*>(shared_); }
  void forget() { std::memset(shared_, 0, sizeof(CallWatch)); }
  void forget_calls() {
    (*this)->found = (*this)->told = 0;
    std::memset(static_cast<void*>((*this)->calls.data()), 0, sizeof((*this)->calls));
  }
  /// To call in the child, before it becomes the program.
  void preload() const {
    ::setenv("LD_PRELOAD", ISORIG_CALL_WATCH_LIBRARY, 1);
    ::setenv("ISORIG_CALL_WATCH", path_.c_str(), 1);
  }
  [[nodiscard]] std::uint32_t told() const { return std::min((*this)->told.load(), CallWatch::kMostCalls); }

 private:
  std::filesystem::path path_;
  void* shared_ = MAP_FAILED;
};

using Calls = std::set<std::pair<std::string, std::string>>;  // thread, call

Calls calls_in(const SharedWatch& watch) {
  Calls all;
  for (std::uint32_t i = 0; i < watch.told(); ++i)
    all.emplace(watch->calls[i].thread.data(), watch->calls[i].call.data());
  return all;
}

/// With the functions that each came from.
std::string in_words(const TempDir& dir, const SharedWatch& watch) {
  std::string text;
  for (std::uint32_t i = 0; i < watch.told(); ++i) {
    const auto& call = watch->calls[i];
    text += std::string(call.thread.data()) + ": " + call.call.data() + ", " + std::to_string(call.times) + " times\n";
    for (const auto& place : call.stack) {
      const std::string at = place.data();
      const auto plus = at.rfind('+');
      if (plus == std::string::npos) continue;
      const auto name = run(dir, {"addr2line", "-Cfpe", at.substr(0, plus), at.substr(plus + 1)}).text;
      text += "    " + (name.empty() || name.front() == '?' ? at + "\n" : name);
    }
  }
  if (watch->found > CallWatch::kMostCalls) text += "and more\n";
  return text;
}

class CallWatchTest : public testing::Test {
 protected:
  /// Runs the program that breaks the contract by `kind`, in each of the threads.
  void plant(const std::string& kind) {
    watch_.forget();
    Process process({bin("call_watch_plant"), kind}, dir_ / "plant.log", [this] { watch_.preload(); });
    ASSERT_EQ(process.wait(60.0), 0) << kind << ": " << process.output();
  }

  TempDir dir_;
  SharedWatch watch_{dir_ / "watch"};
  const std::vector<std::string> threads_{"isorig-loop", "isorig-frame", "isorig-pressure", "isorig-regul",
                                          "isorig-chain"};
};

TEST_F(CallWatchTest, SeesNothingWhereNothingIsDone) {
  ASSERT_NO_FATAL_FAILURE(plant("nothing"));
  EXPECT_EQ(watch_->found, 0U) << in_words(dir_, watch_);
  for (std::size_t i = 0; i < threads_.size(); ++i) {
    EXPECT_EQ(watch_->threads[i].name.data(), threads_[i]);
    EXPECT_GE(watch_->threads[i].waits, 10U) << threads_[i];
  }
}

TEST_F(CallWatchTest, SeesEachKindOfViolationInEachThread) {
  const auto listed = run(dir_, {bin("call_watch_plant"), "list"});
  ASSERT_EQ(listed.code, 0) << listed.text;
  std::istringstream lines(listed.text);
  int kinds = 0;
  for (std::string line; std::getline(lines, line); ++kinds) {
    const auto first = line.find('\t'), second = line.rfind('\t');
    ASSERT_LT(first, second) << line;
    const auto kind = line.substr(0, first), call = line.substr(first + 1, second - first - 1);
    const bool of_loop_alone = line.substr(second + 1) == "loop";
    ASSERT_NO_FATAL_FAILURE(plant(kind));
    const auto seen = calls_in(watch_);
    for (const auto& thread : threads_) {
      const bool due = !of_loop_alone || thread == "isorig-loop";
      EXPECT_EQ(seen.count({thread, call}), due ? 1U : 0U) << kind << " in " << thread << "; seen:\n"
                                                           << in_words(dir_, watch_);
    }
    for (std::uint32_t i = 0; i < watch_.told(); ++i) {
      const auto& stack = watch_->calls[i].stack;
      EXPECT_TRUE(std::any_of(stack.begin(), stack.end(),
                              [](const auto& place) {
                                return std::string_view(place.data()).find("/call_watch_plant+0x") !=
                                       std::string_view::npos;
                              }))
          << kind << ": the stack does not say where it was called from";
    }
  }
  EXPECT_GE(kinds, 30);
}

class RealtimeCalls : public WireRig {
 protected:
  std::string rig_text() const override {
    // A machine that stands still for seconds is no failure of the daemon: what fails then throws, as it should.
    auto text = replaced(WireRig::rig_text(), "response_timeout_ms = 500", "response_timeout_ms = 1500");
    text = replaced(text, "frame_age_max_s = 2.0", "frame_age_max_s = 3.0");
    return text + "\n[lcm]\nenabled = false\n";
  }
  void in_daemon() const override { watch_.preload(); }

  /// Of each thread by name: how often it touched memory that was not resident (proc(5): minflt and majflt of stat).
  std::map<std::string, long> page_faults() {
    std::map<std::string, long> out;
    const auto tasks = std::filesystem::path("/proc") / std::to_string(daemon_->process().pid()) / "task";
    for (const auto& task : std::filesystem::directory_iterator(tasks)) {
      const std::string stat = slurp(task.path() / "stat");
      const auto open = stat.find('('), close = stat.rfind(')');
      std::istringstream rest(stat.substr(close + 2));  // from field 3 on
      std::vector<std::string> fields{std::istream_iterator<std::string>(rest), {}};
      out[stat.substr(open + 1, close - open - 1)] = std::stol(fields.at(7)) + std::stol(fields.at(9));
    }
    return out;
  }

  /// Pages that the kernel has moved since it was booted, of whatever process: an isorigd's faults may come from that.
  static long pages_moved() {
    std::istringstream counts(slurp("/proc/vmstat"));
    std::string name;
    for (long count = 0; counts >> name >> count;)
      if (name == "pgmigrate_success") return count;
    return 0;
  }

  /// A protocol of some seconds under the watch. False when a device did not answer meanwhile, or the kernel moved
  /// locked pages: that is not the steady state that this is about.
  bool run_watched() {
    spit(dir_ / "watched.toml", R"(format = "isorig-protocol/1"
name = "watched"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 4, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "repeat", for = { direction = [1, -1, 1] }, steps = [
    { do = "ramp", to_mm = "direction * 0.5", velocity_mm_s = 2 },
    { do = "hold", duration_s = 0.5 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 1, record = "averaged" },
    { do = "hold", duration_s = 0.5 },
  ] },
]
)");
    const auto errors = [this] {
      const auto s = daemon_->status();
      return s["frame"].value("errors", -1) + s["pressure"].value("errors", -1) + s["interlock"].value("errors", -1);
    };
    const int errors_before = errors();
    watch_.forget_calls();
    const auto id = started_run(daemon_->call({"start", (dir_ / "watched.toml").string()}));
    EXPECT_TRUE(daemon_->reach("running")) << daemon_->status().dump(2);
    const auto faults_before = page_faults();
    const auto moved_before = pages_moved();
    watch_->is_on = 1;
    const auto watched = daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 150.0);
    watch_->is_on = 0;
    const auto faults = page_faults();
    const std::string status = slurp("/proc/" + std::to_string(daemon_->process().pid()) + "/status");
    const bool locked = status.find("VmLck:\t       0 kB") == std::string::npos;
    if (!locked) std::printf("  this machine locks no memory for us: page faults are not judged\n");
    EXPECT_NE(status.find("THP_enabled:\t0"), std::string::npos) << "the kernel may unmap our pages for huge ones";
    // Compaction that may move locked pages, and did, explains a fault: then that run says nothing of the daemon.
    const bool moved =
        slurp("/proc/sys/vm/compact_unevictable_allowed").starts_with("1") && pages_moved() != moved_before;
    bool moved_ours = false;
    for (const auto& thread : threads_) {
      if (!locked) break;
      EXPECT_TRUE(faults_before.contains(thread)) << thread;
      const bool waited = faults.at(thread) != faults_before.at(thread);
      moved_ours = moved_ours || (moved && waited);
      EXPECT_TRUE(moved || !waited) << thread << " waited for pages of memory: " << faults_before.at(thread) << " -> "
                                    << faults.at(thread);
    }
    EXPECT_EQ(watched.code, 0) << watched.text << daemon_->status().dump(2) << daemon_->log();
    if (moved_ours)
      std::printf("  the kernel moved locked pages (sysctl vm.compact_unevictable_allowed=0 forbids it)\n");
    return errors() == errors_before && !moved_ours;
  }

  void judge(bool rtu) {
    watch_->loop_period_ns = 1'000'000;
    ASSERT_NO_FATAL_FAILURE(start(rtu));
    int disturbed = 0;
    while (!HasFailure() && !run_watched()) {
      std::printf("  a device was late, or pages were moved; once more\n%s", daemon_->log().c_str());
      ASSERT_LT(++disturbed, 4) << "not one run without a device that was late or pages that were moved:\n"
                                << daemon_->log();
    }
    EXPECT_EQ(watch_->found, 0U) << in_words(dir_, watch_);
    for (const auto& thread : threads_) {
      const auto* own = std::find_if(watch_->threads.begin(), watch_->threads.end(),
                                     [&](const WatchedThread& t) { return thread == t.name.data(); });
      ASSERT_NE(own, watch_->threads.end()) << thread << " was not watched";
      EXPECT_GT(own->waits, 50U) << thread;
      const bool talks = thread != "isorig-loop" && thread != "isorig-chain";  // the chain of this rig is not on a line
      EXPECT_EQ(own->talks > 50U, talks) << thread << ": " << own->talks;
      std::printf("  %s: %llu turns, %llu reads and writes\n", thread.c_str(),
                  static_cast<unsigned long long>(own->waits), static_cast<unsigned long long>(own->talks));
    }
    EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
  }

  SharedWatch watch_{dir_ / "watch"};
  std::vector<std::string> threads_{"isorig-loop", "isorig-frame", "isorig-pressure", "isorig-chain"};
};

TEST_F(RealtimeCalls, NoneIsForbiddenOverModbusTcpAndATerminal) {
  judge(false);
}

TEST_F(RealtimeCalls, NoneIsForbiddenOverModbusRtu) {
  judge(true);
}

class RealtimeCallsWithRegulator : public RealtimeCalls {
 protected:
  RealtimeCallsWithRegulator() { threads_.emplace_back("isorig-regul"); }
  std::string rig_text() const override {
    auto text = RealtimeCalls::rig_text();
    const auto loop = text.find("[pressure_loop]\n"), next = text.find("\n[", loop);
    text.replace(loop, next - loop,
                 "[pressure_loop]\nactuator = \"regulator\"\nintegral_time_s = "
                 "5.0\nrate_limit_psi_s = 5.0\n");
    return text + "\n[regulator]\nmap = \"" + source("config/regulators/alicat.toml") +
           "\"\ntransport = \"rtu\"\ntty = \"" + (dir_ / "regulator").string() +
           "\"\nbaud = 115200\nmax_psi = 24.0\nage_max_s = "
           "2.0\nresponse_timeout_ms = 1500\n";
  }
};

TEST_F(RealtimeCallsWithRegulator, NoneIsForbidden) {
  judge(false);
}

}  // namespace
}  // namespace isorig::system_test
