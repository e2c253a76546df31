#include "daemon/host/callout.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <sstream>
#include <thread>
#include <vector>

#include "base/toml_reader.hpp"
#include "daemon/core/fixed_text.hpp"
#include "daemon/rig/config.hpp"
#include "recording_rig.hpp"
#include "tree.hpp"
#include "wait_until.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

EventRecord event(const char* code, RunState from, RunState to, const char* text = "") {
  EventRecord e;
  copy_text(e.code, code);
  copy_text(e.text, text);
  e.from = from;
  e.to = to;
  return e;
}
const EventRecord kDone = event("run.done", RunState::kRunning, RunState::kStopping, "protocol finished");

class CalloutTest : public ::testing::Test {
 protected:
  CalloutTest() { options_.interval_s = 0.01; }
  void TearDown() override { stop(); }

  void start(const std::string& script) {
    options_.command = path("command");
    std::ofstream(options_.command) << "#!/bin/sh\n" << script << "\n";
    ::chmod(options_.command.c_str(), 0755);
    run();
  }
  void run() {
    callout_ = std::make_unique<Callout>(options_, [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      log_.push_back(line);
    });
    thread_ = std::thread([this] { callout_->run(); });
  }
  void stop() {
    if (!thread_.joinable()) return;
    callout_->stop();
    thread_.join();
  }
  [[nodiscard]] std::string path(const char* name) const { return (folder_.path() / name).string(); }
  [[nodiscard]] std::string text(const char* name) const {
    std::ifstream in(path(name));
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
  }
  [[nodiscard]] std::vector<std::string> log() {
    const std::lock_guard lock(mutex_);
    return log_;
  }

  testing::TemporaryDirectory folder_{"callout"};
  NotifyConfig options_;
  std::unique_ptr<Callout> callout_;
  std::thread thread_;
  std::mutex mutex_;
  std::vector<std::string> log_;
};

TEST_F(CalloutTest, TheCommandGetsEventRunTextAndState) {
  ::setenv("NOTIFY_SOCKET", "/nobody", 1);
  start("env > '" + path("env.part") + "'; echo \"$1\" >> '" + path("env.part") + "'; mv '" + path("env.part") + "' '" +
        path("env") + "'");
  callout_->on_event(kDone, "20261122-a-b");
  ASSERT_TRUE(wait_until(20.0, [&] { return !text("env").empty(); }));
  const auto env = text("env");
  EXPECT_THAT(env, HasSubstr("ISORIG_EVENT=done\n"));
  EXPECT_THAT(env, HasSubstr("ISORIG_RUN=20261122-a-b\n"));
  EXPECT_THAT(env, HasSubstr("ISORIG_TEXT=run.done: protocol finished\n"));
  EXPECT_THAT(env, HasSubstr("ISORIG_STATE=stopping\n"));
  EXPECT_THAT(env, HasSubstr("PATH="));
  EXPECT_THAT(env, ::testing::Not(HasSubstr("NOTIFY_SOCKET")));
  EXPECT_THAT(env, ::testing::EndsWith("\ndone\n"));
  stop();
  EXPECT_TRUE(log().empty());
}

TEST_F(CalloutTest, WhatIsCalledAbout) {
  using S = RunState;
  EXPECT_EQ(Callout::name_of(kDone), "done");
  EXPECT_EQ(Callout::name_of(event("run.aborted", S::kRunning, S::kStopping)), "aborted");
  EXPECT_EQ(Callout::name_of(event("limit.force", S::kRunning, S::kFaulted)), "faulted");
  EXPECT_EQ(Callout::name_of(event("limit.force", S::kFaulted, S::kFaulted)), std::nullopt);
  EXPECT_EQ(Callout::name_of(event("held.expired", S::kPaused, S::kFaulted)), "held");
  EXPECT_EQ(Callout::name_of(event("pause", S::kRunning, S::kPaused)), "paused");
  EXPECT_EQ(Callout::name_of(event("reset", S::kFaulted, S::kPaused)), std::nullopt);
  EXPECT_EQ(Callout::name_of(event("ready", S::kIdle, S::kReady)), std::nullopt);
}

TEST_F(CalloutTest, FailuresAreLoggedWithTheCommandsOwnWords) {
  start("echo no route to anybody >&2; exit 3");
  callout_->on_event(kDone, "r");
  ASSERT_TRUE(wait_until(20.0, [&] { return log().size() == 1; }));
  EXPECT_THAT(log()[0], HasSubstr("failed with exit code 3: no route to anybody"));
  stop();
  options_.command = path("missing");
  run();
  callout_->on_event(kDone, "r");
  ASSERT_TRUE(wait_until(20.0, [&] { return log().size() == 2; }));
  EXPECT_THAT(log()[1], HasSubstr("cannot be started: No such file"));
}

TEST_F(CalloutTest, ACommandThatHangsIsEndedWithAllThatItStarted) {
  options_.timeout_s = 0.3;
  start("sleep 1000 & echo $! > '" + path("child") + "'; wait");
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 3; ++i) callout_->on_event(kDone, "r");
  EXPECT_LT(std::chrono::steady_clock::now() - begin,
            std::chrono::milliseconds(100));  // whoever says so waits for nothing
  ASSERT_TRUE(wait_until(20.0, [&] { return !log().empty(); }));
  EXPECT_THAT(log()[0], HasSubstr("took longer than [notify] timeout_s"));
  stop();
  const int child = std::stoi(text("child"));
  EXPECT_TRUE(wait_until(10.0, [&] {
    std::ifstream stat("/proc/" + std::to_string(child) + "/stat");
    std::string id, name, state;
    stat >> id >> name >> state;
    return !stat || state == "Z";
  }));
}

TEST_F(CalloutTest, AFloodIsBoundedAndCounted) {
  options_.interval_s = 3600.0;
  start("echo x >> '" + path("calls") + "'");
  callout_->on_event(kDone, "r");
  ASSERT_TRUE(wait_until(20.0, [&] { return text("calls") == "x\n"; }));
  for (int i = 0; i < 100; ++i) callout_->on_event(kDone, "r");
  std::this_thread::yield();
  EXPECT_EQ(text("calls"), "x\n");
  stop();  // what waits is still called: 16 of them
  EXPECT_LE(text("calls").size(), 2U * 17U);
  ASSERT_FALSE(log().empty());
  EXPECT_THAT(log()[0], HasSubstr("84 calls are given up"));
}

TEST_F(CalloutTest, AHeldRunIsToldOnce) {
  options_.held_s = 100.0;
  start("echo \"$ISORIG_EVENT $ISORIG_STATE $ISORIG_TEXT\" >> '" + path("calls") + "'");
  Status s;
  s.run_loaded = true;
  s.control.state = RunState::kFaulted;
  copy_text(s.fault, "limit.force: too much");
  for (int t = 0; t <= 300; t += 10) {
    s.control.mono_ns = t * 1'000'000'000LL;
    callout_->watch(s, "r", 0.0);
  }
  s.control.state = RunState::kRunning;
  callout_->watch(s, "r", 0.0);
  stop();
  EXPECT_EQ(text("calls"), "held faulted the run has been held for 100 s: limit.force: too much\n");
}

constexpr const char* kTellAll = "echo \"$ISORIG_EVENT $ISORIG_RUN $ISORIG_STATE $ISORIG_TEXT\" >> '";

TEST_F(CalloutTest, ARunThatTakesLongerThanItCanIsOverdueOnce) {
  options_.held_s = 0.0;
  start(kTellAll + path("calls") + "'");
  Status s;
  s.run_loaded = true;
  s.runs_started = 1;
  const auto until = [&](const std::string& run, RunState state, int from_s, int to_s, double longest_s) {
    s.control.state = state;
    for (int t = from_s; t <= to_s; ++t) {
      s.control.mono_ns = t * 1'000'000'000LL;
      callout_->watch(s, run, longest_s);
    }
  };
  until("a", RunState::kArmed, 0, 5000, 1200.0);  // waits for a person: not its plan's time
  until("a", RunState::kRunning, 5001, 6300, 1200.0);
  until("a", RunState::kPaused, 6301, 6320, 1200.0);  // 1319 s: a tenth more than 1200 s is 1320 s
  until("a", RunState::kPaused, 6321, 9000, 1200.0);
  s.runs_started = 2;  // the next one, seen without a look in between, counts from its own begin
  until("b", RunState::kRunning, 9001, 9160, 100.0);  // 159 s: a minute more than 100 s is 160 s
  until("b", RunState::kRunning, 9161, 9400, 100.0);
  s.runs_started = 3;  // paused before it was seen running
  until("c", RunState::kPaused, 9401, 9560, 100.0);
  until("c", RunState::kPaused, 9561, 9600, 100.0);
  s.run_loaded = false;
  until("", RunState::kReady, 9601, 20000, 0.0);
  stop();
  EXPECT_EQ(text("calls"),
            "overdue a paused the run has taken 22.0 min, and its plan takes 20.0 min at the longest\n"
            "overdue b running the run has taken 2.7 min, and its plan takes 1.7 min at the longest\n"
            "overdue c paused the run has taken 2.7 min, and its plan takes 1.7 min at the longest\n");
}

TEST_F(CalloutTest, APartingIsToldAndIsTheCauseOfThePauseThatItAsksFor) {
  start(kTellAll + path("calls") + "'");
  const auto pause = event("pause", RunState::kRunning, RunState::kPaused, "paused by the operator");
  callout_->on_parted("r", "the twin m.toml is off by 3 N", "mark", RunState::kRunning);
  ASSERT_TRUE(wait_until(20.0, [&] { return !text("calls").empty(); }));
  callout_->on_event(pause, "r");  // by a person: the twin only marked
  ASSERT_TRUE(wait_until(20.0, [&] { return text("calls").find("pause") != std::string::npos; }));
  callout_->on_parted("r", "the twin m.toml is off by 4 N", "pause", RunState::kRunning);
  callout_->on_event(pause, "r");
  callout_->on_event(pause, "another");
  callout_->on_event(kDone, "r");
  stop();
  EXPECT_EQ(text("calls"),
            "parted r running the twin m.toml is off by 3 N\n"
            "paused r paused pause: paused by the operator\n"
            "parted r running the twin m.toml is off by 4 N\n"
            "paused r paused pause: paused by the operator; asked for by isorig-web: the twin m.toml is off by 4 N\n"
            "paused another paused pause: paused by the operator\n"
            "done r stopping run.done: protocol finished\n");
}

TEST_F(CalloutTest, PartingsThatRepeatThemselvesTakeOnePlace) {
  options_.interval_s = 3600.0;
  start("echo \"$ISORIG_EVENT\" >> '" + path("calls") + "'");
  callout_->on_event(kDone, "r");
  ASSERT_TRUE(wait_until(20.0, [&] { return text("calls") == "done\n"; }));
  for (int i = 0; i < 100; ++i) callout_->on_parted("r", "off", "mark", RunState::kRunning);
  callout_->on_event(event("limit.force", RunState::kRunning, RunState::kFaulted), "r");
  stop();
  EXPECT_EQ(text("calls"), "done\nparted\nfaulted\n");
  EXPECT_TRUE(log().empty());
}

TEST(NotifyConfigTest, TheCommandIsCheckedBeforeTheRigIsUp) {
  std::ifstream in(isorig::test::source_path() + "/config/rigs/sim.toml");
  std::ostringstream text;
  text << in.rdbuf();
  testing::TemporaryDirectory folder{"notify"};
  const auto check = [&](const std::string& command) -> std::string {
    const auto path = folder.path() / "rig.toml";
    auto whole = text.str();
    for (auto at = whole.find("\"../"); at != std::string::npos; at = whole.find("\"../")) {
      whole.replace(at, 4, "\"" + isorig::test::source_path() + "/config/");
    }
    std::ofstream(path) << whole << "\n[notify]\ncommand = \"" << command << "\"\n";
    try {
      (void)load_rig(path);
    } catch (const base::ConfigError& e) {
      return e.what();
    }
    return {};
  };
  EXPECT_EQ(check("/bin/true"), "");
  EXPECT_THAT(check("mail"), HasSubstr("absolute path"));
  EXPECT_THAT(check("/no/such/command"), HasSubstr("there is no such file"));
  EXPECT_THAT(check("/etc/passwd"), HasSubstr("not an executable file"));
  EXPECT_THAT(check("/bin"), HasSubstr("cannot be run"));
}

}  // namespace
}  // namespace isorig::daemon::test
