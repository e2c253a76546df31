#include "fault_matrix_expect.hpp"

#include <algorithm>
#include <stdexcept>
#include <string_view>

#include "daemon/core/seconds.hpp"

namespace isorig::daemon::test {
namespace {

using Mask = unsigned;
using Kind = Expected::Kind;

constexpr Mask bit(At at) {
  return 1U << static_cast<unsigned>(at);
}
constexpr Mask kReady = bit(At::kReady), kArmed = bit(At::kArmed), kCountdown = bit(At::kCountdown),
               kSetup = bit(At::kSetup), kJog = bit(At::kJog), kApproach = bit(At::kApproach), kFill = bit(At::kFill),
               kLower = bit(At::kLower), kSettle = bit(At::kSettle), kHold = bit(At::kHold), kSlow = bit(At::kSlow),
               kFast = bit(At::kFast), kTriangle = bit(At::kTriangle), kSine = bit(At::kSine),
               kPaused = bit(At::kPaused), kSealed = bit(At::kSealed), kHeld = bit(At::kHeld),
               kStopping = bit(At::kStopping);
constexpr Mask kAll = (1U << kSituations) - 1;
constexpr Mask kBetween = kReady | kArmed;
constexpr Mask kVentedRest = kCountdown | kSetup;
constexpr Mask kStrokes = kSlow | kFast | kTriangle | kSine;
constexpr Mask kQuick = kFast | kTriangle | kSine;
constexpr Mask kMoves = kJog | kApproach | kStrokes;
constexpr Mask kRests = kFill | kLower | kSettle | kHold;
constexpr Mask kWaits = kPaused | kSealed | kHeld;
constexpr Mask kLive = kVentedRest | kMoves | kRests | kWaits | kStopping;  ///< every state but idle, ready, armed
constexpr Mask kRuns = kRests | kStrokes | kWaits;                          ///< under pressure
constexpr Mask kVented = kBetween | kVentedRest | kJog;
constexpr Mask kRecorded = kCountdown | kApproach | kRuns;

struct Rule {
  std::string_view fault;
  Mask where;
  Expected what;
};

Expected trips(double within_s, std::vector<std::string> codes) {
  return {Kind::kTrips, std::move(codes), within_s, {}};
}
Expected not_ready(const char* words) {
  return {Kind::kNotReady, {words}, 0.0, {}};
}
Expected stands_down() {
  return {Kind::kStandsDown, {}, 0.0, {}};
}
Expected rides() {
  return {};
}
Expected unseen(const char* why) {
  return {Kind::kUnseen, {}, 0.0, why};
}
Expected impossible(const char* why) {
  return {Kind::kImpossible, {}, 0.0, why};
}

// A poll of 5 ms, a tick, and what the frame's clock leaves open.
constexpr double kAtOnce_s = 0.02;
constexpr double kStale_s = 0.25 + 0.01;

constexpr const char* kNoSegment = "no segment is commanded from there on";
constexpr const char* kNoPause = "there is nothing to pause, or it is paused";
constexpr const char* kNoRecord = "nothing is recorded";
constexpr const char* kNoPressure = "vented: it shows the room's pressure as before, and nothing flows";
constexpr const char* kNoFlow = "nothing has to flow through it then";
constexpr const char* kNoValve =
    "at the set-point no valve moves, and nothing flows (docs/states.md, what the guard cannot see)";
constexpr const char* kAlwaysLow =
    "it has read too little since before the filling: relief valve, force limit, `isorig calibrate`";

std::vector<Rule> rules() {
  std::vector<Rule> all;
  const auto add = [&](std::string_view fault, Mask where, const Expected& what) {
    all.push_back({fault, where, what});
  };
  for (const char* f : {"FrameAnswerLost", "FrameAnswerSpoilt", "FrameException", "FrameFourLost", "SamplesLost",
                        "SamplesCorrupt", "TeensyDelay", "LoopALittleLate"}) {
    add(f, kAll, rides());
  }
  // The frame's link.
  add("FrameFiveLost", kArmed | kCountdown, stands_down());
  add("FrameFiveLost", kMoves, trips(0.1, {"frame.stopped"}));
  add("FrameFiveLost", kAll, rides());
  for (const char* f : {"FrameSilent", "FrameSpoiltForGood", "FrameExceptions", "FrameDisconnected",
                        "FrameSamplesFrozen", "FrameRegistersFrozen"}) {
    add(f, kBetween, not_ready("no samples from the frame"));
    add(f, kLive, trips(kStale_s, {"stale.frame"}));
  }
  add("FrameNotANumber", kBetween, not_ready("no numbers"));
  add("FrameNotANumber", kLive, trips(kAtOnce_s, {"frame.number"}));
  add("FrameHeartbeatRefused", kBetween | kStopping, not_ready("heartbeat"));
  add("FrameHeartbeatRefused", kLive, trips(0.5 + 0.02, {"frame.heartbeat"}));
  for (const char* f : {"FrameClockJumps", "TeensyClockJumps"}) {
    add(f, kBetween | kStopping, not_ready("clocks are being measured"));
    add(f, kCountdown, stands_down());
    add(f, kAll, rides());
  }
  // Its motion. The time counts from the strike, so that it has the rest of the stroke in it.
  for (const char* f : {"SegmentRefused", "SegmentEchoedWrong"}) {
    add(f, kJog | kApproach, trips(0.1, {"frame.segment"}));
    add(f, kStrokes, trips(1.0, {"frame.segment"}));
  }
  // The last chord of a sine's quarter is shorter than the permitted error: that it is not reached ends the step.
  add("SegmentIgnored", kSine, trips(8.0, {"protocol"}));
  add("SegmentIgnored", kJog | kApproach | kStrokes, trips(3.0, {"frame.following"}));
  for (const char* f : {"Overshoots", "RunsAway"}) add(f, kJog | kApproach | kStrokes, trips(6.0, {"frame.following"}));
  for (const char* f : {"SegmentRefused", "SegmentEchoedWrong", "SegmentIgnored", "Overshoots", "RunsAway"})
    add(f, kAll, impossible(kNoSegment));
  add("NeverReached", kApproach | kStrokes, trips(8.0, {"protocol"}));
  add("NeverReached", kJog, rides());
  add("NeverReached", kAll, impossible(kNoSegment));
  add("DriveTrips", kBetween, not_ready("the frame reports a fault"));
  add("DriveTrips", kLive, trips(kAtOnce_s, {"frame.fault"}));
  add("FaultState", kBetween, not_ready("fault state"));
  add("FaultState", kLive, trips(kAtOnce_s, {"frame.fault"}));
  // The stop.
  constexpr Mask kNothingToPause = kReady | kSetup | kWaits | kStopping;
  for (const char* f : {"StopBusy", "StopRefused", "StopLostOnce", "StopLost", "StopNotDone"})
    add(f, kNothingToPause, impossible(kNoPause));
  for (const char* f : {"StopBusy", "StopLostOnce"}) add(f, kAll, rides());
  add("StopRefused", kArmed, rides());
  add("StopRefused", kAll, trips(0.3 + 0.03, {"frame.stop"}));
  for (const char* f : {"StopLost", "StopNotDone"}) {
    add(f, kMoves, trips(0.3 + 0.03, {"frame.stop"}));
    add(f, kAll, rides());
  }
  // Load cell, reference.
  add("CellUnplugged", kBetween | kStopping, not_ready("force reading does not change"));
  add("CellUnplugged", kLive, trips(1.0 + 0.02, {"force.frozen"}));
  for (const char* f : {"CellOffScale", "CellOffScaleLow"}) add(f, kAll, trips(kAtOnce_s, {"limit.force"}));
  add("FrameRestarts", kBetween | kStopping, not_ready("zero is not confirmed"));
  add("FrameRestarts", kLive, trips(0.1, {"frame.reference"}));
  // The Teensy's link, the sensor.
  for (const char* f : {"TeensySilent", "TeensyCorruptForGood", "TeensyUnplugged"}) {
    add(f, kBetween, not_ready("no valid pressure"));
    add(f, kLive, trips(kStale_s, {"stale.pressure"}));
  }
  add("TeensyReboots", kReady, rides());
  add("TeensyReboots", kArmed, stands_down());
  add("TeensyReboots", kLive, trips(kStale_s, {"stale.pressure"}));
  for (const char* f : {"SensorStale", "SensorDiagnostic", "SensorFrozen", "SensorRailLow", "SensorRailHigh"}) {
    add(f, kBetween, not_ready("no valid pressure"));
    // While its fill valve is open the Teensy is sooner, after 0.1 s.
    add(f, kRests | kStrokes | kPaused, trips(kStale_s, {"teensy.sensor", "stale.pressure"}));
    add(f, kLive, trips(kStale_s, {"stale.pressure"}));
  }
  add("SensorStuck", kBetween, not_ready("no valid pressure"));
  add("SensorStuck", kVentedRest | kJog, trips(5.02, {"pressure.frozen"}));
  add("SensorStuck", kApproach, trips(3.0, {"teensy.stuck"}));
  add("SensorStuck", kFill, trips(0.5, {"teensy.stuck"}));
  add("SensorStuck", kLower | kStopping, trips(0.6, {"pressure.no_vent"}));
  add("SensorStuck", kLive, trips(5.02, {"pressure.frozen", "pressure.hold", "teensy.stuck"}));
  add("SensorDrifts", kVented | kStopping, unseen("a vented rig is ready below 0.5 psi: calibrate before a campaign"));
  add("SensorDrifts", kAll, unseen("a leak may do as much: relief valve, force limit, `isorig calibrate`"));
  add("TubeOff", kVented | kStopping, unseen(kNoPressure));
  add("TubeOff", kApproach, trips(3.0, {"pressure.no_response"}));
  add("TubeOff", kAll, trips(0.05, {"pressure.no_response", "pressure.falls"}));
  add("TubeBlocked", kVented, unseen(kNoPressure));
  add("TubeBlocked", kSettle | kHold | kSlow | kWaits, unseen(kNoValve));
  add("TubeBlocked", kApproach, trips(3.0, {"pressure.no_response"}));
  add("TubeBlocked", kFill, trips(0.5, {"pressure.no_response"}));
  add("TubeBlocked", kLower | kStopping, trips(0.6, {"pressure.no_vent"}));
  // A reading near the set-point: what binds is the pressure, 3 psi at most, not the time (docs/states.md).
  add("TubeBlocked", kQuick, trips(15.0, {"pressure.hold"}));
  add("TubeKinked", kVented | kStopping, unseen(kNoPressure));
  add("TubeKinked", kSealed | kHeld, unseen(kNoFlow));
  add("TubeKinked", kApproach, trips(3.0, {"pressure.no_response"}));
  add("TubeKinked", kFill | kLower, trips(1.5, {"pressure.no_response"}));
  add("TubeKinked", kAll, trips(15.0, {"pressure.no_response", "pressure.hold"}));
  add("ReadsLow", kVented | kStopping, unseen(kNoPressure));
  add("ReadsLow", kApproach, unseen(kAlwaysLow));
  add("ReadsLow", kAll, trips(0.05, {"pressure.no_response", "pressure.falls"}));
  // Valves, hoses, supply.
  add("FillStuckOpen", kBetween, not_ready("under pressure"));
  add("FillStuckOpen", kStopping, trips(20.1, {"vent.stuck"}));
  add("FillStuckOpen", kAll, trips(0.1, {"pressure.rises", "pressure.no_vent"}));
  add("FillStuckShut", kVented | kStopping | kSealed | kHeld | kLower, unseen(kNoFlow));
  add("FillStuckShut", kApproach, trips(3.0, {"pressure.no_response"}));
  add("FillStuckShut", kFill, trips(0.5, {"pressure.no_response"}));
  add("FillStuckShut", kAll, trips(4.0, {"pressure.hold"}));
  add("VentStuckOpen", kVented | kStopping, unseen("open is where it has to be then"));
  add("VentStuckOpen", kApproach, trips(6.0, {"pressure.hold", "pressure.no_response"}));
  add("VentStuckOpen", kFill, trips(8.0, {"pressure.hold", "pressure.no_response"}));
  add("VentStuckOpen", kSealed | kHeld, trips(0.1, {"pressure.falls"}));
  add("VentStuckOpen", kAll, trips(1.0, {"pressure.hold", "pressure.no_response"}));
  add("VentStuckShut", kVented | kFill | kSettle | kHold | kSlow | kWaits | kStopping,
      unseen("nothing has to flow through it then, or the dump valve vents as well"));
  add("VentStuckShut", kApproach, trips(5.0, {"pressure.no_vent"}));
  add("VentStuckShut", kLower, trips(0.6, {"pressure.no_vent"}));
  add("VentStuckShut", kAll, trips(1.0, {"pressure.hold"}));
  add("DumpStuckShut", kAll, unseen("it is asked for in a safe state alone; the vent valve vents, in 5 s from 20 psi"));
  add("CommandsLost", kVented | kStopping | kSealed | kHeld,
      unseen("no command changes then, or the dump valve vents"));
  add("CommandsLost", kApproach, trips(3.0, {"pressure.no_response"}));
  add("CommandsLost", kFill, trips(1.0, {"pressure.no_vent"}));
  add("CommandsLost", kLower, trips(2.0, {"pressure.no_vent"}));
  add("CommandsLost", kAll, trips(4.0, {"pressure.hold"}));
  add("HoseBursts", kVented | kStopping, unseen("there is no pressure to lose"));
  add("HoseBursts", kApproach, trips(6.0, {"pressure.no_response", "pressure.falls"}));
  add("HoseBursts", kFill, trips(1.5, {"pressure.no_response", "pressure.falls"}));
  add("HoseBursts", kAll, trips(0.6, {"pressure.no_response", "pressure.falls"}));
  add("SupplyEmpty", kApproach, trips(6.0, {"pressure.no_response"}));
  add("SupplyEmpty", kFill, trips(8.0, {"pressure.no_response"}));
  add("SupplyEmpty", kAll, unseen("what is behind the fill valve lasts for that; a filling shows it"));
  add("SupplyHigh", kAll, unseen("the loop keeps its set-point; `limit.pressure`, relief valve"));
  // Interlock.
  const struct {
    const char *fault, *words, *code;
  } contacts[] = {{"EmergencyStop", "emergency-stop chain", "interlock.estop"},
                  {"GuardOpens", "guard is open", "interlock.guard"},
                  {"InputsLost", "cannot be read", "interlock.lost"}};
  for (const auto& c : contacts) {
    add(c.fault, kBetween, not_ready(c.words));
    add(c.fault, kLive, trips(kAtOnce_s, {c.code}));
  }
  add("ContactBounces", kReady, rides());
  add("ContactBounces", kArmed, stands_down());
  add("ContactBounces", kLive, trips(kAtOnce_s, {"interlock.estop"}));
  // The machine.
  add("LoopLate", kBetween | kHeld, rides());
  add("LoopLate", kLive, trips(kAtOnce_s, {"loop.late"}));
  for (const char* f : {"LoopHangs", "Stopped"}) {
    add(f, kReady, rides());
    add(f, kArmed, stands_down());
    add(f, kHeld, trips(1.0 + kAtOnce_s, {"pressure.watchdog", "frame.heartbeat"}));
    add(f, kLive, trips(1.0 + kAtOnce_s, {"loop.late"}));
  }
  for (const char* f : {"DiskFull", "DiskHangs", "DiskSlow"}) add(f, kBetween | kSetup | kJog, impossible(kNoRecord));
  add("DiskFull", kRecorded, trips(1.5, {"recorder"}));
  add("DiskFull", kStopping, unseen("the run is over; what is left of it goes to the reserve"));
  add("DiskHangs", kRecorded, trips(10.0 + 0.05, {"recorder.stalled"}));
  add("DiskHangs", kStopping, unseen("the run is over, and is not called done before its end is written"));
  add("DiskSlow", kAll, rides());
  return all;
}

bool is_one_of(std::string_view name, std::initializer_list<std::string_view> list) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

}  // namespace

const Expected& expected(const Fault& fault, At at) {
  static const std::vector<Rule> all = rules();
  for (const auto& rule : all) {  // the first that fits
    if (rule.fault == fault.name && (rule.where & bit(at)) != 0) return rule.what;
  }
  throw std::logic_error(std::string("nothing is said of ") + fault.name + " in " + situation(at).name);
}

Bounds bounds(const Fault& fault, const Expected& e) {
  Bounds b;
  b.by_itself = is_one_of(fault.name, {"FrameSilent", "FrameDisconnected", "FrameHeartbeatRefused", "StopRefused",
                                       "StopLost", "StopNotDone", "LoopHangs", "Stopped"});
  // Through vent and dump valve from 20 psi, 0.8 s; a Teensy that has rebooted or hangs, and its watchdog: 0.5 s more.
  b.vents_s = 2.5;
  if (is_one_of(fault.name, {"InputsLost"})) b.vents_s = 6.0;  // nobody can let go of the dump valve
  if (is_one_of(fault.name, {"FillStuckOpen"})) b.rest_psi = 4.0;
  b.watch_s = std::max(8.0, e.within_s + 3.0);
  return b;
}

Losses losses(const Fault& fault) {
  constexpr double kPerSecond = 1000.0;
  constexpr double kRetry_s = 0.05, kFramePoll_s = 0.005;
  // A link that is still dead when the recording ends, 7 s after the run, has brought nothing since the fault.
  constexpr double kNeverHeard_s = kStale_s + seconds(Core::kRecordedAfterNs);
  // While everything stands the devices keep what their rings hold (sim.toml: 256 and 512).
  constexpr double kStopped_s = 1.0 + 2.0 * kFramePoll_s;
  Losses l;
  if (is_one_of(fault.name, {"SamplesLost", "SamplesCorrupt"})) l.pressure.missing = 20.0;
  if (is_one_of(fault.name, {"FrameFiveLost"}))
    l.frame.missing = kPerSecond * (5.0 * kFramePoll_s + kRetry_s + kFramePoll_s);
  if (is_one_of(fault.name, {"FrameRestarts"})) l.frame.missing = kPerSecond * (kFramePoll_s + kRetry_s + kFramePoll_s);
  if (is_one_of(fault.name, {"Stopped"})) {
    l.frame.missing = kPerSecond * kStopped_s - 256.0;
    l.pressure.missing = kPerSecond * kStopped_s - 512.0;
  }
  if (is_one_of(fault.name, {"FrameSilent", "FrameSpoiltForGood", "FrameExceptions", "FrameDisconnected"}))
    l.frame.unheard = kPerSecond * kNeverHeard_s;
  if (is_one_of(fault.name, {"TeensySilent", "TeensyCorruptForGood", "TeensyUnplugged"}))
    l.pressure.unheard = kPerSecond * kNeverHeard_s;
  // It counts from 0 again: tried after 0.05, 0.15, 0.35 and 0.75 s.
  if (is_one_of(fault.name, {"TeensyReboots"})) l.pressure.unheard = kPerSecond * 0.76;
  return l;
}

}  // namespace isorig::daemon::test
