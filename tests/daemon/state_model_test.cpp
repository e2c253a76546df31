#include "state_model.hpp"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <map>
#include <set>

/// The rig's states, enumerated against the real Core, its services and the plant, in virtual time.
///
/// Every act of an alphabet (verbs, faults that begin, repair, time that passes) is tried in every situation that is
/// reached, breadth first, from rest and from the ways below: running, moving, paused, held, faulted. Two situations
/// count as one when they agree in all that key() holds; timers that run are not in it. After each act the rig is
/// watched until it stands and is vented, or should be. At every millisecond the plant's truth is the witness of the
/// invariants:
///
///   ready      means that the crosshead stands and the actuator is vented
///   a stop     ends in standstill within the frame's watchdog time
///   fill       is commanded in a run alone, never in a stop, a fault or at rest
///   pressure   passes its limit by no more than flows in while a wrong reading or a valve that stays open is found
///   safe state ends vented where a vent exists, or below 4 psi against a fill valve that stays open
///   verbs      are accepted in the states that docs/states.md names, and in no other
///   done       is not said of a run that a safe state ended, that the recorder cannot keep, or that is elsewhere than
///              its plan ends; a run that was held by a fault, reset and resumed may be done
///   setup      is no faster than a jog may be, and nothing moves in it, armed or in a countdown without an act
///   abort      is heard, whatever another client says in the same millisecond
///
/// It is played for a rig that starts with one act, and for one that is armed first; with a plan that lasts, and with a
/// short one that is done within two acts. The recorder comes round, stands still or cannot write.
/// Faults come one at a time. Two acts follow each way, three a rig at rest; ISORIG_STATE_MODEL_ACTS=12 has twelve, or
/// as many as lead to a new situation, ISORIG_STATE_MODEL_FAULTS=2 has faults in pairs: many minutes to hours.
namespace isorig::daemon::test {
namespace {

/// How a situation is reached from rest, and what it has to be.
struct Way {
  std::vector<const char*> acts;
  RunState state;
  bool moves = false;
  std::size_t further = 0;  ///< acts that are tried from here, above those of every way
};

int act_of(const std::string& name) {
  for (int act = 0; act < kActs; ++act) {
    if (name_of(act) == name) return act;
  }
  throw std::invalid_argument("no act \"" + name + "\"");
}

const std::vector<Way> kWays = {
    {{}, RunState::kReady, false, 1},
    {{"start"}, RunState::kRunning},
    {{"start", "1 s"}, RunState::kRunning},  // filling, near its set-point
    {{"start", "3 s"}, RunState::kRunning, true},
    {{"start", "3 s", "pause"}, RunState::kPaused},
    {{"start", "3 s", "loop 0.4 s late", "everything repaired"}, RunState::kFaulted},  // held
    {{"start", "3 s", "guard open", "everything repaired"}, RunState::kFaulted},       // vented
    {{"setup", "jog", "0.1 s"}, RunState::kSetup, true},
};

const std::vector<Way> kArmedWays = {
    {{}, RunState::kReady},
    {{"start, to be armed", "go"}, RunState::kCountdown},
    {{"start, to be armed", "go", "3 s"}, RunState::kRunning, true},
    {{"start, to be armed", "go", "3 s", "pause", "0.1 s"}, RunState::kPaused},
    {{"start, to be armed", "go", "3 s", "pause", "3 s", "resume"}, RunState::kArmed},
    {{"start, to be armed", "go", "3 s", "pause", "3 s", "resume", "go"}, RunState::kCountdown},
    {{"start, to be armed", "go", "3 s", "loop 0.4 s late", "everything repaired"}, RunState::kFaulted},  // held
    {{"start, to be armed", "go", "3 s", "guard open", "everything repaired"}, RunState::kFaulted},       // vented
};

int asked(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoi(text);
}

class StateModelTest : public StateModel {
 protected:
  /// What became of an act, and of the time after it.
  struct Found {
    std::string key, broken;
  };
  void go(const Way& way);
  Found try_act(int act);
  void enumerate(const std::vector<Way>& ways, int acts, std::size_t least);

 private:
  struct Open {
    Acts acts;
    std::size_t most = 0;  ///< acts, with the way's
  };
  std::set<std::string> seen_;
  std::deque<Open> open_;
};

void StateModelTest::go(const Way& way) {
  Acts acts;
  for (const auto* name : way.acts) acts.push_back(act_of(name));
  ASSERT_TRUE(play(acts)) << name_of(acts) << "\n    " << broken;
  ASSERT_EQ(to_text(virtual_rig->core().state()), std::string(to_text(way.state))) << name_of(acts);
  if (way.moves) {
    ASSERT_GT(std::abs(virtual_rig->rig().truth().velocity_mm_s), kMoving_mm_s) << name_of(acts);
  }
}

/// In a copy of this process, so that the way here is gone once for all acts.
StateModelTest::Found StateModelTest::try_act(int act) {
  int ends[2];
  std::fflush(nullptr);
  if (::pipe2(ends, O_CLOEXEC) != 0) return {"", "no pipe"};
  const pid_t child = ::fork();
  if (child == 0) {
    tally = {};
    doing = name_of(act);
    do_act(act);
    const auto found = key();
    settle();
    std::ostringstream said;
    said << tally.vents << ' ' << tally.stops << ' ' << tally.dones << ' ' << tally.faulted_runs << ' '
         << tally.overfills << ' ' << tally.highest_psi << ' ' << found << '\n'
         << broken;
    const auto text = said.str();
    const bool is_whole = ::write(ends[1], text.data(), text.size()) == static_cast<ssize_t>(text.size());
    ::_exit(is_whole ? 0 : 1);
  }
  ::close(ends[1]);
  std::string text;
  char buffer[1024];
  for (ssize_t n = 0; (n = ::read(ends[0], buffer, sizeof buffer)) > 0;)
    text.append(buffer, static_cast<std::size_t>(n));
  ::close(ends[0]);
  int ended = 0;
  if (child < 0 || ::waitpid(child, &ended, 0) != child || ended != 0) return {"", "the copy died"};
  Tally there;
  Found found;
  std::istringstream said(text);
  said >> there.vents >> there.stops >> there.dones >> there.faulted_runs >> there.overfills >> there.highest_psi >>
      std::ws;
  std::getline(said, found.key);
  std::getline(said, found.broken, '\0');
  tally += there;
  return found;
}

void StateModelTest::enumerate(const std::vector<Way>& ways, int acts, std::size_t least) {
  const int at_once = asked("ISORIG_STATE_MODEL_FAULTS", 1);
  const auto most = static_cast<std::size_t>(asked("ISORIG_STATE_MODEL_ACTS", acts));
  for (const auto& way : ways) {
    go(way);
    if (HasFatalFailure()) return;
    seen_.insert(key());
    Acts there;
    for (const auto* name : way.acts) there.push_back(act_of(name));
    open_.push_back({there, there.size() + way.further + most});
  }
  std::size_t tried = 0, deepest = 0;
  std::map<std::string, std::string> failures;  // the shortest way to each
  while (!open_.empty()) {
    const auto [here, most_here] = open_.front();
    open_.pop_front();
    play(here);
    const unsigned faults_here = faults;
    for (int act = 0; act < kActs; ++act) {
      const bool fault = act >= kFirstFault && act < kRepair;
      if (fault && (__builtin_popcount(faults_here) >= at_once || (faults_here >> (act - kFirstFault) & 1U) != 0))
        continue;
      Acts next = here;
      next.push_back(act);
      ++tried;
      const auto found = try_act(act);
      if (!found.broken.empty()) {
        failures.emplace(found.broken.substr(0, found.broken.find(':')), name_of(next) + "\n    " + found.broken);
        continue;
      }
      deepest = std::max(deepest, next.size());
      if (seen_.insert(found.key).second && next.size() < most_here) open_.push_back({next, most_here});
    }
  }
  std::printf(
      "%zu situations, %zu acts tried, up to %zu after each other; %zu times vented, %zu stopped in motion, "
      "%zu runs done, %zu stopped by a fault, %zu times over the pressure limit, by %.2f psi at most\n",
      seen_.size(), tried, deepest, tally.vents, tally.stops, tally.dones, tally.faulted_runs, tally.overfills,
      tally.highest_psi - kLimit_psi);
  for (const auto& [kind, example] : failures) ADD_FAILURE() << example;
  EXPECT_GT(seen_.size(), least);
  EXPECT_GT(tally.vents, 0U);
  EXPECT_GT(tally.stops, 0U);
  EXPECT_GT(tally.faulted_runs, 0U);
}

/// The number of docs/safety.md: no third act leads here in the suite.
TEST_F(StateModelTest, AFillValveThatStaysOpenWhileTheLoopIsAwayPassesTheLimitByWhatFlowsIn) {
  const Acts acts{act_of("start"), act_of("fill valve open"), act_of("loop 0.4 s late"), act_of("loop 0.4 s late")};
  ASSERT_TRUE(play(acts)) << broken;
  settle();
  EXPECT_EQ(broken, "");
  const double over_psi = tally.highest_psi - kLimit_psi;
  std::printf("over the limit by %.2f psi\n", over_psi);
  EXPECT_GT(over_psi, kReadMargin_psi) << "then the margin for it is too wide";
  EXPECT_LT(over_psi, kReadMargin_psi + kAwayMargin_psi);
}

TEST_F(StateModelTest, EveryActInEverySituation) {
  enumerate(kWays, 2, 140);
  EXPECT_GT(tally.overfills, 0U);
}

TEST_F(StateModelTest, EveryActInEverySituationOfARigThatIsArmed) {
  arming = true;
  enumerate(kArmedWays, 2, 95);
}

/// Done 1.7 s after its start.
TEST_F(StateModelTest, EveryActInEverySituationOfAShortRun) {
  set_plan(R"(
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 8, settled_for_s = 0.1, timeout_s = 20 },
  { do = "ramp", to_mm = 0.6, velocity_mm_s = 1 },)",
           0.6);
  // What is done sooner than a recorder is found to stand still needs one that has stood still before.
  enumerate({{{}, RunState::kReady}, {{"start"}, RunState::kRunning}, {{"recorder stands still"}, RunState::kReady}}, 2,
            250);
  EXPECT_GT(tally.dones, 0U);
}

}  // namespace
}  // namespace isorig::daemon::test
