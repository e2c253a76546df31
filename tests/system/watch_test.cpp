// `isorig watch` at a real terminal: the alternate screen, resizing, leaving, and whose end it waits for.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <optional>

#include "processes.hpp"
#include "terminal.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kEnter = "\x1b[?1049h";
constexpr const char* kLeave = "\x1b[?1049l";
const std::string kSmoke = source("config/protocols/vma-smoke.toml");

/// Columns of the widest line that stands between two cursor movements, escape sequences not counted.
int widest(const std::string& drawn) {
  int widest = 0, width = 0;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    if (drawn[i] == '\x1b') {
      while (i < drawn.size() && (std::isalpha(static_cast<unsigned char>(drawn[i])) == 0)) ++i;
      if (i < drawn.size() && drawn[i] == 'H') width = 0;
    } else if (drawn[i] == '\r' || drawn[i] == '\n') {
      width = 0;
    } else if ((static_cast<unsigned char>(drawn[i]) & 0xC0U) != 0x80U) {
      widest = std::max(widest, ++width);
    }
  }
  return widest;
}

class Watch : public testing::Test {
 protected:
  void SetUp() override {
    ::unsetenv("NO_COLOR");
    ::setenv("TERM", "xterm", 1);
    daemon_.emplace(dir_, patient_rig(dir_));
    ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  }
  std::vector<std::string> words(std::vector<std::string> more = {}) {
    std::vector<std::string> all{bin("isorig"), "watch", "--interval-s", "0.1", "--socket", daemon_->socket()};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  TempDir dir_;
  std::optional<DaemonProcess> daemon_;
};

TEST_F(Watch, StaysOnTheAlternateScreenWithinItsSizeAndLeavesTheRunAlone) {
  const auto id = started_run(daemon_->call({"start", kSmoke}));
  Terminal terminal(words(), {60, 15});
  ASSERT_TRUE(terminal.shows(kEnter)) << terminal.shown();
  ASSERT_TRUE(terminal.shows(id)) << terminal.shown();
  ASSERT_TRUE(terminal.shows("q leaves the view; the run goes on")) << terminal.shown();
  EXPECT_LE(widest(terminal.shown()), 60);
  const auto before = terminal.shown().size();

  terminal.resize({100, 30});
  ASSERT_TRUE(terminal.shows("scatter")) << terminal.shown();  // stands beyond column 60
  EXPECT_THAT(widest(terminal.shown().substr(before)), testing::AllOf(testing::Gt(60), testing::Le(100)));
  EXPECT_THAT(terminal.shown(), HasSubstr("\x1b[1;30;42m"));  // running

  terminal.type("q");
  EXPECT_EQ(terminal.wait(), 0);
  EXPECT_THAT(terminal.shown(), HasSubstr(kLeave));
  EXPECT_THAT(terminal.shown().substr(terminal.shown().rfind(kLeave)), HasSubstr("goes on"));
  EXPECT_EQ(daemon_->status()["run"]["id"], id);
}

TEST_F(Watch, RespectsNoColorAndEverySignalGivesTheScreenBack) {
  ::setenv("NO_COLOR", "1", 1);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    Terminal terminal(words(), {80, 24});
    ASSERT_TRUE(terminal.shows("q leaves the view")) << terminal.shown();
    EXPECT_THAT(terminal.shown(), Not(HasSubstr("[1;")));
    EXPECT_THAT(terminal.shown(), Not(HasSubstr("[3")));
    terminal.signal(number);
    EXPECT_EQ(terminal.wait(), 0);
    EXPECT_THAT(terminal.shown(), HasSubstr(kLeave)) << number;
  }
  ::unsetenv("NO_COLOR");
  // A daemon that goes away and does not come back within 30 s: the screen is given back before that is said.
  Terminal terminal(words(), {80, 24});
  ASSERT_TRUE(terminal.shows("q leaves the view")) << terminal.shown();
  daemon_->process().stop(SIGTERM);
  EXPECT_EQ(terminal.wait(), 4);
  EXPECT_THAT(terminal.shown().substr(terminal.shown().rfind(kLeave)), HasSubstr("no daemon answers"));
}

TEST_F(Watch, IsLeftAtOnceWhileTheDaemonHangs) {
  // A look is three calls at most (status, events, plan), each given up after 2 s; then comes the key or the signal.
  // 4 s more are for a machine that is busy with other things. A call's own patience would be 30 s.
  constexpr double kLimit_s = 3 * 2.0 + 4.0;
  std::optional<Terminal> before(std::in_place, words(), TerminalSize{100, 24});
  ASSERT_TRUE(before->shows("rig ")) << before->shown();
  ASSERT_EQ(::kill(daemon_->process().pid(), SIGSTOP), 0);
  ASSERT_TRUE(before->shows("isorigd does not answer; what stands here is that old", 2 * kLimit_s)) << before->shown();
  const auto leaves = [&](Terminal& terminal, const std::function<void()>& act, const char* how) {
    act();
    const auto from = std::chrono::steady_clock::now();
    EXPECT_EQ(terminal.wait(kLimit_s), 0) << how;
    EXPECT_LT(std::chrono::steady_clock::now() - from, std::chrono::duration<double>(kLimit_s)) << how;
    EXPECT_THAT(terminal.shown(), HasSubstr(kLeave)) << how;
  };
  {
    Terminal terminal(words(), {80, 24});  // the daemon has hung from the beginning
    ASSERT_TRUE(terminal.shows(kEnter)) << terminal.shown();
    leaves(
        terminal, [&] { terminal.signal(SIGTERM); }, "SIGTERM in the first look");
  }
  for (const char* key : {"q", Terminal::kCtrlC}) {
    Terminal terminal(words(), {80, 24});
    ASSERT_TRUE(terminal.shows("no news for")) << terminal.shown();
    leaves(
        terminal, [&] { terminal.type(key); }, *key == 'q' ? "q" : "Ctrl-C");
  }
  // The daemon goes on, and so does the view: its bar has the colour of a state again.
  ASSERT_EQ(::kill(daemon_->process().pid(), SIGCONT), 0);
  EXPECT_TRUE(wait_until(2 * kLimit_s, [&] {
    return before->shows("\x1b[1;30;46m", 0.0) || before->shows("\x1b[1;97;41m", 0.0);  // ready, or tripped by the halt
  })) << before->shown();
  leaves(
      *before, [&] { before->signal(SIGHUP); }, "SIGHUP");
}

/// A service that was killed is started again within seconds: whoever waits for its run for 23 hours waits on.
TEST_F(Watch, AKilledDaemonIsWaitedForAndFollowedFurther) {
  const auto run = started_run(daemon_->call({"start", kSmoke}));
  Process follower(words(), dir_ / "follower.txt");
  Process awaits(words({"--until-done", "--run", "latest"}), dir_ / "awaits.txt");
  const auto lines = [&](const Process& of) {
    const auto shown = of.output();
    return std::count(shown.begin(), shown.end(), '\n');
  };
  ASSERT_TRUE(wait_until(20.0, [&] { return lines(follower) > 2 && lines(awaits) > 2; })) << follower.output();
  daemon_->process().stop(SIGKILL);
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_TRUE(follower.running()) << follower.output();
  EXPECT_TRUE(awaits.running()) << awaits.output();
  const auto before = lines(follower);
  daemon_.emplace(dir_, dir_ / "rig.toml");
  ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  EXPECT_TRUE(wait_until(10.0, [&] { return lines(follower) > before; })) << follower.output();
  EXPECT_EQ(follower.stop(SIGINT, 10.0), 0) << follower.output();
  EXPECT_EQ(awaits.wait(10.0), 1) << awaits.output();
  EXPECT_THAT(awaits.output(), HasSubstr("run " + run + ": interrupted"));
  // Where none was there from the beginning, nobody waits.
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0);
  EXPECT_EQ(daemon_->call({"watch"}).code, 4);
}

/// An operator who wants the rig to stop is told within seconds that nobody does it.
TEST_F(Watch, AnAbortOfADaemonThatHangsSaysSoSoon) {
  ASSERT_EQ(::kill(daemon_->process().pid(), SIGSTOP), 0);
  const auto from = std::chrono::steady_clock::now();
  const auto abort = daemon_->call({"abort"});
  EXPECT_LT(std::chrono::steady_clock::now() - from, std::chrono::seconds(10));  // 5 s, and a busy machine
  EXPECT_EQ(abort.code, 4);
  EXPECT_THAT(abort.text, HasSubstr("nobody knows whether it has taken the abort"));
  EXPECT_THAT(abort.text, HasSubstr("press the emergency stop"));
  daemon_->process().stop(SIGKILL);
}

TEST_F(Watch, UntilDoneWaitsForARunOfItsOwn) {
  // The last run was aborted: nobody who waits for the next one is to hear that.
  const auto first = started_run(daemon_->call({"start", kSmoke}));
  ASSERT_TRUE(wait_until(20.0, [&] { return daemon_->status().contains("run"); }));
  ASSERT_EQ(daemon_->call({"abort"}).code, 0);
  ASSERT_TRUE(wait_until(30.0, [&] { return daemon_->state() == "ready"; })) << daemon_->log();

  // Of a run that is over already, asked by name: its own outcome, at once. Of one that never was: that.
  EXPECT_EQ(daemon_->call({"watch", "--until-done", "--run", first}).code, 1);
  const auto never = daemon_->call({"watch", "--until-done", "--run", "never"});
  EXPECT_EQ(never.code, 1);
  EXPECT_THAT(never.text, HasSubstr("isorig show never"));

  Process waiting(words({"--until-done"}), dir_ / "waiting.txt");
  ASSERT_TRUE(wait_until(10.0, [&] { return waiting.output().find("waiting for the next one") != std::string::npos; }))
      << waiting.output();
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_TRUE(waiting.running()) << waiting.output();
  // Whoever is interrupted has not seen the end, and says so to the script that called it.
  Process interrupted(words({"--until-done"}), dir_ / "interrupted.txt");
  ASSERT_TRUE(wait_until(10.0, [&] { return interrupted.output().find("waiting") != std::string::npos; }));
  EXPECT_EQ(interrupted.stop(SIGINT, 10.0), 1) << interrupted.output();
  EXPECT_THAT(interrupted.output(), HasSubstr("left before the awaited run has been seen to end"));
  const auto own = daemon_->call({"start", kSmoke, "--until-done"}, 120.0);
  EXPECT_EQ(own.code, 0) << own.text;
  EXPECT_EQ(waiting.wait(20.0), 0);

  // Another run has come since, or another isorigd: how the run before it ended is still the answer, for both of them.
  const auto second = started_run(own);
  const auto third = started_run(daemon_->call({"start", kSmoke}));
  ASSERT_TRUE(wait_until(20.0, [&] { return daemon_->status().contains("run"); }));
  const auto asked_for_both = [&](const char* when) {
    const auto done = daemon_->call({"watch", "--until-done", "--run", second});
    EXPECT_EQ(done.code, 0) << when << done.text;
    EXPECT_THAT(done.text, HasSubstr("run " + second + ": done")) << when;
    const auto aborted = daemon_->call({"watch", "--until-done", "--run", first});
    EXPECT_EQ(aborted.code, 1) << when << aborted.text;
    EXPECT_THAT(aborted.text, HasSubstr("run " + first + ": aborted")) << when;
  };
  asked_for_both("while the next runs: ");
  EXPECT_EQ(daemon_->status()["run"]["id"], third);
  ASSERT_EQ(daemon_->call({"abort"}).code, 0);
  ASSERT_TRUE(wait_until(30.0, [&] { return daemon_->state() == "ready"; })) << daemon_->log();
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
  daemon_.emplace(dir_, dir_ / "rig.toml");
  ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  asked_for_both("after a restart: ");
}

}  // namespace
}  // namespace isorig::system_test
