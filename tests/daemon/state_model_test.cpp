#include <cmath>
#include <cstdlib>
#include <deque>
#include <map>
#include <set>
#include <sstream>
#include <string_view>

#include "rig_fixture.hpp"
#include "state_model_acts.hpp"

/// The rig's states, enumerated against the real Core, its services and the plant, in virtual time.
///
/// Every act of an alphabet (verbs, faults that begin, repair, time that passes) is tried in every situation that is
/// reached, breadth first. A situation is reached by doing its acts again from the start. Two situations count as one
/// when they agree in all that key() holds; timers that run are not in it. At every millisecond the plant's truth is
/// the witness of the invariants:
///
///   ready      means that the crosshead stands and the actuator is vented
///   a stop     ends in standstill within the frame's watchdog time
///   fill       is commanded in a run alone, never in a stop, a fault or at rest
///   pressure   stays below its limit, whatever the sensor says
///   safe state ends vented where a vent exists
///   verbs      are accepted in the states that docs/states.md names, and in no other
///   done       is not said of a run that had a fault
///   setup      is no faster than a jog may be, and nothing moves in it, armed or in a countdown without an act
///   abort      is heard, whatever another client says in the same millisecond
///
/// It is played for a rig that starts with one act, and for one that is armed first. The recorder comes round, stands
/// still or cannot write.
/// Faults come one at a time, and three acts follow each other. ISORIG_STATE_MODEL_ACTS=12 goes on until no new
/// situation appears or twelve acts follow each other, ISORIG_STATE_MODEL_FAULTS=2 has faults in pairs: many minutes.
namespace isorig::daemon::test {
namespace {

constexpr double kVented_psi = 0.7;          // CoreConfig::vented_psi and the sensor's error
constexpr double kMoving_mm_s = 0.05;        // less is the crosshead's regulation
constexpr double kPressureMargin_psi = 2.0;  // what flows in while a wrong reading is found out
constexpr double kStop_s = 0.5 + 0.25;       // the frame's own watchdog, and its brake
constexpr double kVent_s = 8.0;
constexpr double kOvershoot = 1.1;  // the simulated drive passes the speed it is told by 5 % when it sets off

class StateModelTest : public RigFixture {
 protected:
  void SetUp() override {
    config.core.vent_time_max_s = 4.0;
    config.core.recorder_age_max_s = 2.0;
    plan = protocol::compile(base::TomlDocument::parse_text(R"(format = "isorig-protocol/1"
name = "model"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
])",
                                                            "model.toml"),
                             config.limits);
  }

  /// From rest to where `acts` lead. False when an invariant was broken; `broken` says which.
  bool play(const Acts& acts) {
    config.core.operating.arming_required = arming;
    config.core.operating.arm_window_s = 2.0;
    config.core.operating.countdown_s = 1.0;
    rebuild();
    faults = 0;
    disk_fails = recorder_hangs = had_fault = false;
    jog_until_ns = -1;
    broken.clear();
    last_state = RunState::kIdle;
    left_running_ns = vented_since_ns = -1;
    pass(1.5);
    for (const int act : acts) {
      doing = name_of(act);
      if (!broken.empty()) return false;
      do_act(act);
    }
    return broken.empty();
  }

  void do_act(int act) {
    if (act < kFirstFault) {
      say(kVerbs[act]);
      pass(0.05);
    } else if (act < kRepair) {
      faults |= 1U << (act - kFirstFault);
      kFaults[act - kFirstFault].set(virtual_rig->rig(), true);
      pass(0.1);
    } else if (act == kRepair) {
      for (const auto& f : kFaults) f.set(virtual_rig->rig(), false);
      faults = 0;
      disk_fails = recorder_hangs = false;
      virtual_rig->core().set_recorder_fault("");
      pass(1.0);
    } else if (act == kDiskFails) {
      disk_fails = true;
      virtual_rig->core().set_recorder_fault("the disk fails");
      pass(0.1);
    } else if (act == kRecorderHangs) {
      recorder_hangs = true;
      pass(2.2);  // recorder_age_max_s, and two looks
    } else if (act >= kFirstPair) {
      say(kPairs[act - kFirstPair]);
      pass(0.05);
    } else if (act == kLoopLate) {
      virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
      pass(0.1);
    } else {
      pass(act == kMoment ? 0.1 : 3.0);
    }
  }

  void push(Verb verb) {
    Request request;
    request.verb = verb;
    request.id = ++last_id;
    request.plan = &plan;
    request.target_mm = kJogTarget_mm;
    virtual_rig->core().requests.push(request);
    if (verb == Verb::kJog)
      jog_until_ns = virtual_rig->now_ns() + static_cast<std::int64_t>(config.core.operating.jog_time_max_s * 1e9);
  }

  void say(const PairKind& pair) {
    push(pair.first);
    push(pair.second);
    step();
    for (int i = 0; i < 2; ++i) {
      Reply reply;
      if (!virtual_rig->core().replies.pop(reply)) return fail("a verb was not answered");
      if (!reply.accepted && reply.text[0] == '\0') fail("refused without a word");
      const bool abort = (i == 0 ? pair.first : pair.second) == Verb::kAbort;
      if (abort && !reply.accepted) fail(std::string("abort refused: ") + reply.text);
    }
    const auto state = virtual_rig->core().state();
    if (pair.second == Verb::kAbort &&
        (state == RunState::kRunning || state == RunState::kPaused || state == RunState::kArmed ||
         state == RunState::kCountdown || state == RunState::kSetup))
      fail("an abort was not heard");
  }

  void say(const VerbKind& kind) {
    const RunState before = virtual_rig->core().state();
    push(kind.verb);
    step();
    Reply reply;
    if (!virtual_rig->core().replies.pop(reply)) return fail("the verb was not answered");
    if (reply.accepted && std::find(kind.from.begin(), kind.from.end(), before) == kind.from.end()) {
      fail(std::string("accepted while ") + to_text(before));
    }
    if (!reply.accepted && reply.text[0] == '\0') fail("refused without a word");
    if (kind.verb == Verb::kAbort && !reply.accepted)
      fail(std::string("abort refused while ") + to_text(before) + ": " + reply.text);
  }

  void pass(double seconds) {
    const auto until_ns = virtual_rig->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (broken.empty() && virtual_rig->now_ns() < until_ns) step();
    drain();
    events.clear();
  }

  void step() {
    tick();
    if (!recorder_hangs) virtual_rig->core().recorder_turn(virtual_rig->now_ns());
    look();
  }

  /// The invariants.
  void look() {
    const auto now_ns = virtual_rig->now_ns();
    const auto state = virtual_rig->core().state();
    const auto truth = virtual_rig->rig().truth();
    const bool moves = std::abs(truth.velocity_mm_s) > kMoving_mm_s;
    if (state != last_state) {
      if (state == RunState::kRunning && last_state == RunState::kReady) had_fault = false;
      if (state == RunState::kFaulted) had_fault = true;
      last_state = state;
    }
    const bool jogs = state == RunState::kSetup && now_ns <= jog_until_ns;
    if (state == RunState::kRunning || jogs) {
      left_running_ns = -1;
    } else if (left_running_ns < 0) {
      left_running_ns = now_ns;
    }
    if ((state == RunState::kReady || state == RunState::kIdle) && moves) fail("moves");
    if (state == RunState::kReady && truth.pressure_psi > kVented_psi && !reading_lies(faults))
      fail("ready under pressure");
    if (left_running_ns >= 0 && moves && seconds(now_ns - left_running_ns) > kStop_s) fail("did not come to rest");
    const auto fill = virtual_rig->pressure_command().fill_permille;
    // A paused run that is armed to go on, or counts down, is held.
    const bool held =
        (state == RunState::kArmed || state == RunState::kCountdown) && virtual_rig->core().status().run_loaded;
    if (fill > 0 && state != RunState::kRunning && state != RunState::kPaused && !held) fail("fills");
    if (state == RunState::kSetup &&
        std::abs(truth.velocity_mm_s) > kOvershoot * config.core.operating.jog_speed_max_mm_s)
      fail("is faster than a jog in setup");
    if (truth.pressure_psi > config.limits.pressure_max_psi + kPressureMargin_psi) fail("over the pressure limit");
    const bool to_vent =
        state == RunState::kStopping || (state == RunState::kFaulted && virtual_rig->core().status().vented_fault);
    if (!to_vent) {
      vented_since_ns = -1;
    } else if (vented_since_ns < 0) {
      vented_since_ns = now_ns;
    } else if (seconds(now_ns - vented_since_ns) > kVent_s && truth.pressure_psi > 1.0) {
      fail("a safe state does not vent");
    }
    if (virtual_rig->core().outcome() == Outcome::kDone && had_fault && state == RunState::kStopping && disk_fails) {
      fail("done while the disk fails");
    }
    if (state == RunState::kFaulted && seconds(now_ns - left_running_ns) > 0.05 &&
        virtual_rig->core().status().fault[0] == '\0') {
      fail("a fault without a cause");
    }
  }

  void fail(const std::string& what) {
    if (!broken.empty()) return;
    std::ostringstream text;
    const auto t = virtual_rig->rig().truth();
    text << what << ": " << to_text(virtual_rig->core().state()) << ", " << t.velocity_mm_s << " mm/s, "
         << t.pressure_psi << " psi, fault \"" << virtual_rig->core().status().fault << "\", while " << doing;
    broken = text.str();
  }

  static double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

  /// What makes a situation.
  [[nodiscard]] std::string key() const {
    const auto s = virtual_rig->core().status();
    const auto t = virtual_rig->rig().truth();
    const auto c = virtual_rig->pressure_command();
    std::ostringstream k;
    const auto state = virtual_rig->core().state();
    const bool under_way = s.run_loaded;
    k << to_text(state) << '|' << faults << '|' << disk_fails << recorder_hangs << '|' << under_way << s.vented_fault
      << s.healthy << '|'
      << (state == RunState::kFaulted ? std::string_view(s.fault).substr(0, std::string_view(s.fault).find(':')) : "")
      << '|' << (std::abs(t.velocity_mm_s) > kMoving_mm_s) << (t.pressure_psi > kVented_psi) << '|'
      << (c.fill_permille > 0) << (c.vent_permille > 0) << '|'
      << (under_way ? static_cast<std::int32_t>(s.control.step) : -1);
    return k.str();
  }

  void enumerate(std::size_t least);

  static constexpr double kJogTarget_mm = 3.0;
  bool arming = false;
  unsigned faults = 0;
  bool disk_fails = false;
  bool recorder_hangs = false;
  std::int64_t jog_until_ns = -1;
  bool had_fault = false;
  RunState last_state = RunState::kIdle;
  std::int64_t left_running_ns = -1;
  std::int64_t vented_since_ns = -1;
  std::string doing, broken;
};

int asked(const char* variable, int otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::atoi(text);
}

void StateModelTest::enumerate(std::size_t least) {
  const int at_once = asked("ISORIG_STATE_MODEL_FAULTS", 1);
  const auto most_acts = static_cast<std::size_t>(asked("ISORIG_STATE_MODEL_ACTS", 3));
  std::set<std::string> seen;
  std::deque<Acts> open{{}};
  play({});
  seen.insert(key());
  std::size_t tried = 0, deepest = 0;
  std::map<std::string, std::string> failures;  // the shortest way to each
  while (!open.empty()) {
    const Acts here = open.front();
    open.pop_front();
    play(here);
    const unsigned faults_here = faults;
    for (int act = 0; act < kActs; ++act) {
      const bool fault = act >= kFirstFault && act < kRepair;
      if (fault && (__builtin_popcount(faults_here) >= at_once || (faults_here >> (act - kFirstFault) & 1U) != 0))
        continue;
      Acts next = here;
      next.push_back(act);
      ++tried;
      if (!play(next)) {
        failures.emplace(broken.substr(0, broken.find(':')), name_of(next) + "\n    " + broken);
        continue;
      }
      if (next.size() < most_acts && seen.insert(key()).second) {
        deepest = std::max(deepest, next.size());
        open.push_back(next);
      }
    }
  }
  std::printf("%zu situations, %zu acts tried, %zu acts deep\n", seen.size(), tried, deepest);
  for (const auto& [kind, example] : failures) ADD_FAILURE() << example;
  EXPECT_GT(seen.size(), least);
}

TEST_F(StateModelTest, EveryActInEverySituation) {
  enumerate(140);  // 154
}

TEST_F(StateModelTest, EveryActInEverySituationOfARigThatIsArmed) {
  arming = true;
  enumerate(95);  // 103
}

}  // namespace
}  // namespace isorig::daemon::test
