// How isorigd and isorig run end: signals, a disk that hangs, a terminal that stands still, crowds on the socket.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cstring>
#include <memory>
#include <regex>

#include "daemon/recording/catalogue.hpp"
#include "last_state.hpp"
#include "messages/run_log.hpp"
#include "processes.hpp"
#include "terminal.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

const std::string kSmoke = source("config/protocols/vma-smoke.toml");

double seconds_since(std::chrono::steady_clock::time_point t) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - t).count();
}

std::string state_of(const DaemonProcess& daemon, const std::string& id) {
  const daemon::Catalogue catalogue(daemon.runs(), daemon::Catalogue::Access::kReadOnly);
  const auto row = catalogue.find_run(id);
  return row ? row->state : "";
}

/// Under pressure, with a disk that can be made to hang.
class EndingTest : public testing::Test {
 protected:
  void start(const std::function<void()>& in_child = {}, const std::string& protocol = kSmoke) {
    daemon_ = std::make_unique<DaemonProcess>(dir_, patient_rig(dir_), [this, in_child] {
      ::setenv("LD_PRELOAD", ISORIG_SLOW_SYNC_LIBRARY, 1);
      ::setenv("ISORIG_SLOW_SYNC", gate_.c_str(), 1);
      if (in_child) in_child();
    });
    ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
    id_ = started_run(daemon_->call({"start", protocol}));
    ASSERT_TRUE(wait_until(30.0, [&] { return daemon_->status().value("pressure_psi", 0.0) > 4.0; }));
  }
  void hang_disk() {
    spit(gate_, "");
    ASSERT_TRUE(wait_until(20.0, [&] { return std::filesystem::exists(gate_ + ".waiting"); }));
  }
  /// Vented, as the stop socket shows it: for as long as the process is there.
  bool vented(double seconds) {
    return wait_until(seconds, [&] {
      const auto s = daemon_->status();
      return s.is_object() && s.value("pressure_psi", 99.0) < 0.6 && (s["state"] == "idle" || s["state"] == "ready");
    });
  }

  TempDir dir_;
  std::string gate_ = (dir_ / "gate").string();
  std::string id_;
  std::unique_ptr<DaemonProcess> daemon_;
};

TEST_F(EndingTest, ASignalStopsTheRigWhileTheDiskHangsAndTheRunIsWrittenLater) {
  start();
  hang_disk();
  const auto began = std::chrono::steady_clock::now();
  ::kill(daemon_->process().pid(), SIGTERM);
  // The API closes when the rig is at rest, so a status may come too late: the journal says it.
  static const std::regex kAtRest("at rest: the crosshead stands, (-?[0-9.]+) psi left");
  std::smatch said;
  std::string log;
  ASSERT_TRUE(wait_until(10.0, [&] {
    log = daemon_->log();
    return std::regex_search(log, said, kAtRest);
  })) << log;
  EXPECT_LT(std::stod(said[1]), 0.6);
  std::printf("  SIGTERM with a hanging disk: at rest and vented after %.2f s\n", seconds_since(began));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_TRUE(daemon_->process().running());
  std::filesystem::remove(gate_);
  EXPECT_EQ(daemon_->process().wait(30.0), 0) << daemon_->log();
  EXPECT_EQ(state_of(*daemon_, id_), "aborted");
  messages::RunVisitor nothing;
  EXPECT_TRUE(messages::read_run(dir_ / "runs" / id_, nothing).whole());
}

TEST_F(EndingTest, AbortStatusAndPauseDoNotWaitForTheDisk) {
  start();
  hang_disk();
  const auto began = std::chrono::steady_clock::now();
  EXPECT_EQ(daemon_->call({"pause"}).code, 0) << daemon_->log();
  EXPECT_EQ(daemon_->call({"abort"}).code, 0) << daemon_->log();
  std::printf("  pause and abort with a hanging disk: %.2f s\n", seconds_since(began));
  EXPECT_LT(seconds_since(began), 2.0);
  EXPECT_TRUE(vented(10.0));
  std::filesystem::remove(gate_);
  EXPECT_TRUE(wait_until(20.0, [&] { return !daemon_->status().contains("run"); }));
  EXPECT_EQ(state_of(*daemon_, id_), "aborted");
}

TEST_F(EndingTest, ARecorderThatHangsIsAProgramStop) {
  start();
  hang_disk();
  ASSERT_TRUE(daemon_->reach("faulted", 30.0));  // recorder_age_max_s is 10 s
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("recorder.stalled"));
  std::filesystem::remove(gate_);
}

TEST_F(EndingTest, ASecondSignalLeavesWhenTheRigIsAtRest) {
  start();
  hang_disk();
  ::kill(daemon_->process().pid(), SIGTERM);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const auto began = std::chrono::steady_clock::now();
  EXPECT_EQ(daemon_->process().stop(SIGTERM, 15.0), 1) << daemon_->log();
  std::printf("  second SIGTERM with a hanging disk: gone after %.2f s\n", seconds_since(began));
  EXPECT_FALSE(std::filesystem::exists(daemon_->socket()));
  std::filesystem::remove(gate_);
  EXPECT_EQ(state_of(*daemon_, id_), "interrupted");
}

class EndingSignalTest : public EndingTest, public testing::WithParamInterface<int> {};

/// In motion and under pressure; the recording goes on until the rig is at rest.
TEST_P(EndingSignalTest, EndsARunOrderly) {
  spit(dir_ / "slow.toml", R"(format = "isorig-protocol/1"
name = "slow"
recording.policy = "full"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.5, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.2 },
]
)");
  start({}, (dir_ / "slow.toml").string());
  ASSERT_TRUE(wait_until(30.0, [&] { return daemon_->status().value("position_mm", 0.0) > 0.2; }));
  EXPECT_EQ(daemon_->process().stop(GetParam()), 0) << daemon_->log();
  EXPECT_EQ(state_of(*daemon_, id_), "aborted");
  LastState last;
  const auto report = messages::read_run(dir_ / "runs" / id_, last);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
  EXPECT_GT(last.peak_psi(), 4.0);
  EXPECT_LT(last.last_psi(), 0.6);
  EXPECT_GT(last.last_mm(), 0.2);
  EXPECT_LT(last.last_mm(), 3.9) << "the ramp was over";
  // Six sigma of the position's noise to either side, and what counts as standing for 0.2 s (docs/states.md). The ramp
  // goes through 0.04 mm.
  EXPECT_LT(last.travel_mm(0.2), 2 * 6 * 0.0002 + 0.2 * 0.02);
  EXPECT_FALSE(std::filesystem::exists(daemon_->socket()));
  EXPECT_FALSE(std::filesystem::exists(daemon_->socket() + ".stop"));
}
INSTANTIATE_TEST_SUITE_P(Signals, EndingSignalTest, testing::Values(SIGHUP, SIGQUIT, SIGINT));

TEST_F(EndingTest, SignalsThatMeanNothingHereEndNothing) {
  start();
  for (const int number : {SIGUSR1, SIGUSR2, SIGALRM, SIGTSTP, SIGTTOU, SIGPIPE})
    ::kill(daemon_->process().pid(), number);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(daemon_->state(), "running");
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0);
}

/// Ctrl-S, or a pipe that nobody reads: its buffer is full from the beginning.
TEST_F(EndingTest, AnOutputThatNobodyTakesHoldsUpNothing) {
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  ::fcntl(ends[1], F_SETPIPE_SZ, 4096);
  ::fcntl(ends[1], F_SETFL, O_NONBLOCK);
  const std::string block(512, 'x');
  while (::write(ends[1], block.data(), block.size()) > 0) {
  }
  ::fcntl(ends[1], F_SETFL, 0);  // the daemon's writes wait
  start([&] {
    ::dup2(ends[1], STDOUT_FILENO);
    ::dup2(ends[1], STDERR_FILENO);
  });
  const auto began = std::chrono::steady_clock::now();
  EXPECT_EQ(daemon_->call({"pause"}).code, 0);
  EXPECT_TRUE(wait_until(5.0, [&] { return daemon_->call({"resume"}).code == 0; }));  // once it is seen to stand
  EXPECT_LT(seconds_since(began), 2.0);
  const auto term = std::chrono::steady_clock::now();
  EXPECT_EQ(daemon_->process().stop(SIGTERM, 15.0), 0);
  std::printf("  SIGTERM with a stopped terminal: gone after %.2f s\n", seconds_since(term));
  EXPECT_EQ(state_of(*daemon_, id_), "aborted");
  ::close(ends[0]);
  ::close(ends[1]);
}

/// Silent, dripping and never reading clients, on both sockets at once.
TEST_F(EndingTest, NoCrowdOfClientsDelaysAnAbort) {
  start();
  for (const int size : {0, 4, 20, 1000}) {
    std::vector<int> crowd;
    for (int i = 0; i < size; ++i) {
      const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
      if (fd < 0) break;
      sockaddr_un address{};
      address.sun_family = AF_UNIX;
      std::strcpy(address.sun_path, (daemon_->socket() + (i % 2 == 0 ? "" : ".stop")).c_str());
      if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 && i % 3 > 0) {
        const std::string bytes =
            i % 3 == 1 ? "POST /v1/abort HTTP/1.1\r\nHo" : "GET /v1/status HTTP/1.1\r\nHost: x\r\n\r\n";
        (void)::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      }
      crowd.push_back(fd);
    }
    // Pause stands for abort, which could be tried once only: the same way, and as quick.
    const auto began = std::chrono::steady_clock::now();
    const auto paused = daemon_->call({"pause"});
    const double took_s = seconds_since(began);
    EXPECT_EQ(paused.code, 0) << paused.text;
    std::printf("  pause among %4d hostile clients: %.3f s with the program's own start\n", size, took_s);
    EXPECT_LT(took_s, 2.0);
    for (const int fd : crowd) ::close(fd);
    EXPECT_TRUE(wait_until(5.0, [&] { return daemon_->call({"resume"}).code == 0; }));  // once it is seen to stand
  }
  EXPECT_EQ(daemon_->call({"abort"}).code, 0);
}

TEST(Operator, AtATerminalAStartShowsWhatItIsAndAsks) {
  const TempDir dir;
  DaemonProcess daemon(dir, patient_rig(dir));
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const std::vector<std::string> words{bin("isorig"), "start",    kSmoke,         "--operator",
                                       "Ada",         "--socket", daemon.socket()};
  {
    Terminal terminal(words);
    EXPECT_TRUE(terminal.shows("specimen  Control2"));
    EXPECT_TRUE(terminal.shows("operator  Ada"));
    EXPECT_TRUE(terminal.shows("at worst"));
    EXPECT_TRUE(terminal.shows("start? [y/N]"));
    terminal.type(std::string("n") + Terminal::kEnter);
    EXPECT_EQ(terminal.wait(), 5) << terminal.shown();
  }
  EXPECT_EQ(daemon.state(), "ready");
  {
    Terminal terminal(words);
    EXPECT_TRUE(terminal.shows("start? [y/N]"));
    terminal.type(std::string("y") + Terminal::kEnter);
    EXPECT_EQ(terminal.wait(), 0) << terminal.shown();
  }
  EXPECT_EQ(daemon.call({"abort"}).code, 0);
  ASSERT_TRUE(wait_until(30.0, [&] { return !daemon.status().contains("run"); }));
  const auto noted = daemon.call({"note", "latest", "--operator", "Grace", "--text", "the wrong name"});
  EXPECT_EQ(noted.code, 0) << noted.text;
  EXPECT_EQ(daemon.catalogue()[0]["operator"], "Grace");
  EXPECT_THAT(isorig(dir, {"show", "latest", "--runs", daemon.runs()}).text, HasSubstr("the wrong name"));
}

TEST(IsorigRun, ATimeLimitOrAClosedTerminalAbortsIt) {
  const TempDir dir;
  for (const int number : {SIGTERM, SIGHUP}) {
    const auto runs = dir / ("runs-" + std::to_string(number));
    Process process({bin("isorig"), "run", source("config/protocols/vma-isovelocity.toml"), "--rig",
                     source("config/rigs/sim.toml"), "--runs", runs.string()},
                    dir / "run.log");
    ASSERT_TRUE(wait_until(30.0, [&] {
      try {
        return !daemon::Catalogue(runs, daemon::Catalogue::Access::kReadOnly).runs().empty();
      } catch (const std::exception&) {
        return false;
      }
    })) << process.output();
    EXPECT_EQ(process.stop(number), 1) << process.output();
    const auto rows = daemon::Catalogue(runs, daemon::Catalogue::Access::kReadOnly).runs();
    ASSERT_EQ(rows.size(), 1U);
    EXPECT_EQ(rows[0].state, "aborted");
  }
}

}  // namespace
}  // namespace isorig::system_test
