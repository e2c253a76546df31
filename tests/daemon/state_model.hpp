#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <string_view>

#include "rig_fixture.hpp"
#include "state_model_acts.hpp"

/// A rig that acts are done to, one after the other, in virtual time. At every millisecond the plant's truth is held
/// against the invariants that state_model_test.cpp names.
namespace isorig::daemon::test {

constexpr double kVented_psi = 0.7;          // CoreConfig::vented_psi and the sensor's error
constexpr double kMoving_mm_s = 0.05;        // less is the crosshead's regulation
constexpr double kLimit_psi = 10.5;          // the plan goes to 10
constexpr double kOpenFill_psi = 4.0;        // what a fill valve that stays open keeps up against vent and dump valve
constexpr double kReadMargin_psi = 0.5;      // what flows in between a reading above the limit and an open dump valve
constexpr double kPressureMargin_psi = 1.5;  // what flows in while a wrong reading is found out (docs/faults.md)
// ... through a fill valve that stays open while the loop is away: the Teensy vents at the limit by itself, the dump
// valve waits for the loop. Two openings of 0.03 L/(s bar), of which one lets 4.1 bar in and the other 1.7 bar out, and
// 0.25 L: 4.2 psi/s for kAway_s.
constexpr double kAwayMargin_psi = 1.7;
constexpr double kStop_s = 0.5 + 0.25;  // the frame's own watchdog, and its brake
constexpr double kVent_s = 8.0;
constexpr double kLeast_s = kStop_s + 0.1;  // any rig is watched for so long after the last act
constexpr double kOvershoot = 1.1;          // the simulated drive passes the speed it is told by 5 % when it sets off
constexpr double kAway_s = 0.4;             // of a loop that is late
constexpr double kLook_s = 0.05;            // more than the age of a status, which the loop renews every 10 ms
constexpr std::int64_t kStatusNs = 10'000'000;

/// How often an invariant could have been broken. One that no way leads to is no check.
struct Tally {
  std::size_t vents = 0;  ///< safe states and stops of a rig under pressure, watched until vented or kVent_s were over
  std::size_t stops = 0;  ///< of a crosshead that moved, watched until it stood or kStop_s were over
  std::size_t dones = 0;  ///< runs that were said to be done
  std::size_t faulted_runs = 0;  ///< runs that a fault stopped
  std::size_t overfills = 0;     ///< acts after which the true pressure passed the rig's limit
  double highest_psi = 0.0;      ///< of them all

  Tally& operator+=(const Tally& other) {
    vents += other.vents;
    stops += other.stops;
    dones += other.dones;
    faulted_runs += other.faulted_runs;
    overfills += other.overfills;
    highest_psi = std::max(highest_psi, other.highest_psi);
    return *this;
  }
};

class StateModel : public RigFixture {
 protected:
  void SetUp() override {
    config.core.vent_time_max_s = 4.0;
    config.core.recorder_age_max_s = 2.0;
    config.core.supervisor.limits.pressure_max_psi = kLimit_psi;
    set_plan(R"(
  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 1 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 1 },)",
             0.0);
  }

  void set_plan(const std::string& steps, double end_mm) {
    const auto text =
        "format = \"isorig-protocol/1\"\nname = \"model\"\nrecording.policy = \"round_ramps\"\nsteps = [" + steps +
        "\n]\n";
    plan = protocol::compile(base::TomlDocument::parse_text(text, "model.toml"), config.limits);
    plan_end_mm = end_mm;
  }

  /// From rest to where `acts` lead. False when an invariant was broken; `broken` says which.
  bool play(const Acts& acts) {
    config.core.operating.arming_required = arming;
    config.core.operating.arm_window_s = 2.0;
    config.core.operating.countdown_s = 1.0;
    events.clear();
    virtual_rig = std::make_unique<VirtualRig>(config, kQueued);
    faults = 0;
    disk_fails = recorder_hangs = was_loaded = fault_in_run = was_vented = moved_when_left = was_over = false;
    jog_until_ns = recorder_turn_ns = -1;
    back_ns = 0;
    runs_started = 0;
    status = {};
    broken.clear();
    last_outcome = Outcome::kNone;
    last_state = RunState::kIdle;
    left_running_ns = vented_since_ns = faulted_since_ns = -1;
    pass(1.5);
    for (const int act : acts) {
      if (!broken.empty()) return false;
      doing = name_of(act);
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
      be_away(virtual_rig->hang_core);
    } else if (act == kStopped) {
      be_away(virtual_rig->hang_all);
    } else {
      pass(act == kMoment ? 0.1 : act == kSecond ? 1.0 : 3.0);
    }
  }

  /// The plant goes on meanwhile.
  void be_away(bool& hangs) {
    hangs = true;
    back_ns = after(kAway_s);
    pass(kAway_s);
    hangs = false;
    virtual_rig->core().tick(virtual_rig->now_ns() + 1, static_cast<std::int64_t>(kAway_s * 1e9), 0);
    pass(0.1);
  }

  /// After the last act: until the clocks of the invariants have run out, or what they wait for has come.
  void settle() {
    doing += ", and what followed";
    const auto least_ns = after(kLeast_s), most_ns = after(kVent_s + 1.0);
    while (broken.empty() && virtual_rig->now_ns() < (is_settled() ? least_ns : most_ns)) step();
    drain();
    events.clear();
  }

  /// Below this a safe state counts as vented.
  [[nodiscard]] double safe_psi() const { return is_among(faults, "fill valve open") ? kOpenFill_psi : 1.0; }

  [[nodiscard]] bool is_settled() {
    const auto truth = virtual_rig->rig().truth();
    const bool is_to_vent = vented_since_ns >= 0 && truth.pressure_psi > safe_psi();
    const bool is_to_stand = left_running_ns >= 0 && std::abs(truth.velocity_mm_s) > kMoving_mm_s;
    return !is_to_vent && !is_to_stand;
  }

  [[nodiscard]] std::int64_t after(double time_s) const {
    return virtual_rig->now_ns() + static_cast<std::int64_t>(time_s * 1e9);
  }

  void push(Verb verb) {
    Request request;
    request.verb = verb;
    request.id = ++last_id;
    request.plan = &plan;
    request.target_mm = kJogTarget_mm;
    virtual_rig->core().requests.push(request);
  }

  /// Until when a jog may move the crosshead.
  void note_jog(Verb verb, bool accepted) {
    if (!accepted) return;
    if (verb == Verb::kJog) jog_until_ns = after(config.core.operating.jog_time_max_s);
    if (verb == Verb::kPause || verb == Verb::kAbort || verb == Verb::kLeaveSetup) jog_until_ns = -1;
  }

  void say(const PairKind& pair) {
    push(pair.first);
    push(pair.second);
    step();
    for (const Verb verb : {pair.first, pair.second}) {
      Reply reply;
      if (!virtual_rig->core().replies.pop(reply)) return fail("a verb was not answered");
      note_jog(verb, reply.accepted);
      if (!reply.accepted && reply.text[0] == '\0') fail("refused without a word");
      if (verb == Verb::kAbort && !reply.accepted) fail(std::string("abort refused: ") + reply.text);
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
    note_jog(kind.verb, reply.accepted);
    if (reply.accepted && std::find(kind.from.begin(), kind.from.end(), before) == kind.from.end()) {
      fail(std::string("accepted while ") + to_text(before));
    }
    if (!reply.accepted && reply.text[0] == '\0') fail("refused without a word");
    if (kind.verb == Verb::kAbort && !reply.accepted)
      fail(std::string("abort refused while ") + to_text(before) + ": " + reply.text);
  }

  void pass(double time_s) {
    const auto until_ns = after(time_s);
    while (broken.empty() && virtual_rig->now_ns() < until_ns) step();
    drain();
    events.clear();
  }

  void step() {
    tick();
    if (!recorder_hangs) {
      recorder_turn_ns = virtual_rig->now_ns();
      virtual_rig->core().recorder_turn(recorder_turn_ns);
    }
    look();
  }

  /// The invariants.
  void look() {
    const auto now_ns = virtual_rig->now_ns();
    const auto state = virtual_rig->core().state();
    if (now_ns % kStatusNs == 0) status = virtual_rig->core().loop_status();
    const auto truth = virtual_rig->rig().truth();
    const bool moves = std::abs(truth.velocity_mm_s) > kMoving_mm_s;
    look_at_run(state, truth.position_mm);
    look_at_stop(state, moves);
    if ((state == RunState::kReady || state == RunState::kIdle) && moves) fail("moves");
    if (state == RunState::kReady && truth.pressure_psi > kVented_psi && !reading_lies(faults))
      fail("ready under pressure");
    const auto fill = virtual_rig->pressure_command().fill_permille;
    // A paused run that is armed to go on, or counts down, is held.
    const bool held = (state == RunState::kArmed || state == RunState::kCountdown) && status.run_loaded;
    if (fill > 0 && state != RunState::kRunning && state != RunState::kPaused && !held) fail("fills");
    if (state == RunState::kSetup &&
        std::abs(truth.velocity_mm_s) > kOvershoot * config.core.operating.jog_speed_max_mm_s)
      fail("is faster than a jog in setup");
    look_at_limit(truth.pressure_psi);
    look_at_vent(state == RunState::kStopping || (is_told() && status.vented_fault), truth.pressure_psi);
    if (is_told() && status.fault[0] == '\0') fail("a fault without a cause");
  }

  void look_at_limit(double pressure_psi) {
    const double limit_psi = config.core.supervisor.limits.pressure_max_psi;
    tally.highest_psi = std::max(tally.highest_psi, pressure_psi);
    if (pressure_psi > limit_psi && !was_over) ++tally.overfills;
    was_over = pressure_psi > limit_psi;
    double margin_psi = reading_lies(faults) ? kPressureMargin_psi : kReadMargin_psi;
    if (is_among(faults, "fill valve open") && virtual_rig->now_ns() < back_ns + 100'000'000)
      margin_psi += kAwayMargin_psi;
    if (pressure_psi > limit_psi + margin_psi) fail("over the pressure limit");
  }

  /// The rig is faulted, and the status is of this fault.
  [[nodiscard]] bool is_told() const {
    return faulted_since_ns >= 0 && seconds(virtual_rig->now_ns() - faulted_since_ns) > kLook_s;
  }

  /// A run that a safe state ended, that nothing keeps any more, or whose crosshead is not where the plan ends.
  void look_at_run(RunState state, double position_mm) {
    if (status.runs_started != runs_started) {
      runs_started = status.runs_started;
      was_vented = false;
    }
    if (state == RunState::kFaulted && last_state != RunState::kFaulted) {
      fault_in_run = was_loaded;
      tally.faulted_runs += was_loaded ? 1 : 0;
    }
    last_state = state;
    was_loaded = status.run_loaded;
    if (state != RunState::kFaulted) {
      faulted_since_ns = -1;
    } else if (faulted_since_ns < 0) {
      faulted_since_ns = virtual_rig->now_ns();
    }
    if (is_told() && status.vented_fault && fault_in_run) was_vented = true;
    const auto outcome = virtual_rig->core().outcome();
    if (outcome == Outcome::kDone && was_vented) fail("done after a safe state");
    if (outcome != last_outcome && outcome == Outcome::kDone) {
      ++tally.dones;
      const auto& core = config.core;
      if (disk_fails) fail("done while the disk fails");
      if (seconds(virtual_rig->now_ns() - recorder_turn_ns) > core.recorder_age_max_s + kLook_s)
        fail("done while the recorder stands still");
      // "frame.following" would be said of more, at 1 mm/s (docs/states.md).
      if (std::abs(position_mm - plan_end_mm) > core.supervisor.following_error_min_mm + 0.05)
        fail("done away from the plan's end");
    }
    last_outcome = outcome;
  }

  void look_at_stop(RunState state, bool moves) {
    const auto now_ns = virtual_rig->now_ns();
    const bool jogs = state == RunState::kSetup && now_ns <= jog_until_ns;
    if (state == RunState::kRunning || jogs) {
      left_running_ns = -1;
    } else if (left_running_ns < 0) {
      left_running_ns = now_ns;
      moved_when_left = moves;
    }
    const bool is_late = left_running_ns >= 0 && seconds(now_ns - left_running_ns) > kStop_s;
    if (is_late && moves) fail("did not come to rest");
    if (is_late && moved_when_left) {
      ++tally.stops;
      moved_when_left = false;
    }
  }

  void look_at_vent(bool is_to_vent, double pressure_psi) {
    const auto now_ns = virtual_rig->now_ns();
    if (!is_to_vent) {
      vented_since_ns = -1;
    } else if (vented_since_ns < 0) {
      vented_since_ns = now_ns;
      if (pressure_psi > safe_psi()) ++tally.vents;
    } else if (seconds(now_ns - vented_since_ns) > kVent_s && pressure_psi > safe_psi()) {
      fail("a safe state does not vent");
    }
  }

  void fail(const std::string& what) {
    if (!broken.empty()) return;
    std::ostringstream text;
    const auto t = virtual_rig->rig().truth();
    text << what << ": " << to_text(virtual_rig->core().state()) << ", " << t.velocity_mm_s << " mm/s, "
         << t.pressure_psi << " psi, fault \"" << virtual_rig->core().loop_status().fault << "\", while " << doing;
    broken = text.str();
  }

  static double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

  /// What makes a situation.
  [[nodiscard]] std::string key() const {
    const auto s = virtual_rig->core().loop_status();
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

  /// Drained every 10 ms. A copy of this process has less to copy.
  static constexpr std::size_t kQueued = 1024;
  static constexpr double kJogTarget_mm = 3.0;
  bool arming = false;
  double plan_end_mm = 0.0;
  unsigned faults = 0;
  bool disk_fails = false, recorder_hangs = false;
  std::int64_t recorder_turn_ns = -1;
  std::int64_t jog_until_ns = -1;
  std::int64_t back_ns = 0;  ///< the end of the last time the loop was away
  LoopStatus status;         ///< the newest that was taken
  std::uint64_t runs_started = 0;
  bool was_loaded = false, fault_in_run = false;
  bool was_vented = false;  ///< in this run, by a fault
  RunState last_state = RunState::kIdle;
  Outcome last_outcome = Outcome::kNone;
  std::int64_t faulted_since_ns = -1;
  std::int64_t left_running_ns = -1;
  bool moved_when_left = false;
  std::int64_t vented_since_ns = -1;
  bool was_over = false;
  std::string doing, broken;
  Tally tally;
};

}  // namespace isorig::daemon::test
