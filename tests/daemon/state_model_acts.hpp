#pragma once
#include <cstddef>
#include <iterator>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/core/core.hpp"
#include "sim/rig.hpp"

/// The alphabet of the state model: what may be done to a rig, or happen to it (state_model_test.cpp).
namespace isorig::daemon::test {

using Verb = Request::Verb;

struct FaultKind {
  const char* name;
  void (*set)(sim::Rig& rig, bool on);
};

inline const FaultKind kFaults[] = {
    {"frame refuses stops", [](sim::Rig& r, bool on) { r.frame().faults.stop_refused = on ? -1 : 0; }},
    {"frame loses stops", [](sim::Rig& r, bool on) { r.frame().faults.stop_lost = on ? -1 : 0; }},
    {"frame runs on", [](sim::Rig& r, bool on) { r.frame().faults.runs_on = on; }},
    {"frame silent", [](sim::Rig& r, bool on) { r.frame().faults.silent = on; }},
    {"frame gone", [](sim::Rig& r, bool on) { r.frame().faults.disconnected = on; }},
    {"frame samples frozen", [](sim::Rig& r, bool on) { r.frame().faults.frozen_samples = on; }},
    {"drive trips", [](sim::Rig& r, bool on) { r.frame().faults.drive_fault = on; }},
    {"frame ignores segments", [](sim::Rig& r, bool on) { r.frame().faults.ignores_segments = on; }},
    {"Teensy silent", [](sim::Rig& r, bool on) { r.pressure().faults.silent = on; }},
    {"Teensy gone", [](sim::Rig& r, bool on) { r.pressure().faults.disconnected = on; }},
    {"count stuck", [](sim::Rig& r, bool on) { r.pressure().faults.stuck_value = on; }},
    {"tube off", [](sim::Rig& r, bool on) { r.pressure().faults.tube_off = on; }},
    {"tube blocked", [](sim::Rig& r, bool on) { r.pressure().faults.tube_blocked = on; }},
    {"valves ignore commands", [](sim::Rig& r, bool on) { r.pressure().faults.ignores_commands = on; }},
    {"fill valve open", [](sim::Rig& r, bool on) { r.pneumatics().fill_stuck_open = on; }},
    {"vent valve shut", [](sim::Rig& r, bool on) { r.pneumatics().vent_stuck_shut = on; }},
    {"dump valve shut", [](sim::Rig& r, bool on) { r.pneumatics().dump_stuck_shut = on; }},
    {"emergency stop", [](sim::Rig& r, bool on) { r.interlock().estop_closed = !on; }},
    {"guard open", [](sim::Rig& r, bool on) { r.interlock().guard_closed = !on; }},
};
inline constexpr int kFaultCount = static_cast<int>(std::size(kFaults));

inline bool is_among(unsigned faults, std::string_view name) {
  for (int i = 0; i < kFaultCount; ++i) {
    if (kFaults[i].name == name) return (faults >> i & 1U) != 0;
  }
  throw std::invalid_argument("no fault \"" + std::string(name) + "\"");
}

/// Of these the reading does not follow the pressure.
inline bool reading_lies(unsigned faults) {
  return is_among(faults, "count stuck") || is_among(faults, "tube off") || is_among(faults, "tube blocked");
}

struct VerbKind {
  const char* name;
  Verb verb;
  std::vector<RunState> from;  ///< docs/states.md
};

inline const VerbKind kVerbs[] = {
    {"start", Verb::kStart, {RunState::kReady}},
    {"pause", Verb::kPause, {RunState::kRunning, RunState::kArmed, RunState::kCountdown, RunState::kSetup}},
    {"resume", Verb::kResume, {RunState::kPaused}},
    {"abort",
     Verb::kAbort,
     {RunState::kIdle, RunState::kReady, RunState::kRunning, RunState::kPaused, RunState::kStopping, RunState::kFaulted,
      RunState::kArmed, RunState::kCountdown, RunState::kSetup}},
    {"reset", Verb::kReset, {RunState::kFaulted}},
    {"seal", Verb::kSeal, {RunState::kPaused}},
    {"confirm-zero", Verb::kConfirmZero, {RunState::kIdle, RunState::kReady, RunState::kFaulted}},
    {"setup", Verb::kSetup, {RunState::kIdle, RunState::kReady}},
    {"setup --off", Verb::kLeaveSetup, {RunState::kSetup}},
    {"jog", Verb::kJog, {RunState::kSetup}},
    {"start, to be armed", Verb::kArm, {RunState::kReady}},
    {"go", Verb::kGo, {RunState::kArmed}},
};
inline constexpr int kVerbCount = static_cast<int>(std::size(kVerbs));

/// Two clients in the same millisecond.
struct PairKind {
  const char* name;
  Verb first, second;
};
inline const PairKind kPairs[] = {
    {"start and abort at once", Verb::kStart, Verb::kAbort},
    {"abort and start at once", Verb::kAbort, Verb::kStart},
    {"resume and abort at once", Verb::kResume, Verb::kAbort},
    {"reset and resume at once", Verb::kReset, Verb::kResume},
    {"pause and resume at once", Verb::kPause, Verb::kResume},
    {"go and abort at once", Verb::kGo, Verb::kAbort},
    {"jog and abort at once", Verb::kJog, Verb::kAbort},
};
inline constexpr int kPairCount = static_cast<int>(std::size(kPairs));

// An act: 0.. verbs, then faults that begin, then these.
inline constexpr int kFirstFault = kVerbCount;
inline constexpr int kRepair = kFirstFault + kFaultCount;
inline constexpr int kDiskFails = kRepair + 1;
inline constexpr int kLoopLate = kRepair + 2;
inline constexpr int kStopped = kRepair + 3;
inline constexpr int kRecorderHangs = kRepair + 4;
inline constexpr int kMoment = kRepair + 5;
inline constexpr int kSecond = kRepair + 6;
inline constexpr int kWhile = kRepair + 7;
inline constexpr int kFirstPair = kRepair + 8;
inline constexpr int kActs = kFirstPair + kPairCount;

inline std::string name_of(int act) {
  if (act < kFirstFault) return kVerbs[act].name;
  if (act < kRepair) return kFaults[act - kFirstFault].name;
  if (act >= kFirstPair) return kPairs[act - kFirstPair].name;
  switch (act) {
    case kRepair:
      return "everything repaired";
    case kDiskFails:
      return "disk fails";
    case kLoopLate:
      return "loop 0.4 s late";
    case kStopped:
      return "all threads 0.4 s late";
    case kRecorderHangs:
      return "recorder stands still";
    case kMoment:
      return "0.1 s";
    case kSecond:
      return "1 s";
    default:
      return "3 s";
  }
}

using Acts = std::vector<int>;

inline std::string name_of(const Acts& acts) {
  std::string all;
  for (const int act : acts) all += (all.empty() ? "" : ", ") + name_of(act);
  return all;
}

}  // namespace isorig::daemon::test
