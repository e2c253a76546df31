#pragma once
#include <string>

#include "base/toml_reader.hpp"

namespace isorig::daemon {

struct RigConfig;

/// What a rig's keys have to be besides numbers of the right sign: within what the sensor, the frame and their
/// watchdogs can bear, and in the right order to each other. A limit that cannot trip, or that trips when it is too
/// late, is worse than none, because somebody relies on it. Notes every fault at its key: the value, what is allowed,
/// why. docs/config.md lists the ranges.
///
/// `root` is the rig's whole document; of its tables only those keys are looked at whose reader accepted them.
void check_rig(const RigConfig& rig, const base::TomlTable& root);

/// Why the rig's calibration cannot be in force, by the ranges that its file is held to; empty: it can. For corrections
/// that come from elsewhere, the records.
[[nodiscard]] std::string why_no_calibration(const RigConfig& rig);

/// A Teensy vents so long after the last heartbeat (docs/wire-teensy.md), unless its firmware was built otherwise.
inline constexpr double kTeensyWatchdog_s = 0.2;

/// The watchdogs of the rig's devices: without a heartbeat for so long they stop by themselves. Of an emulated or
/// simulated rig as its [sim] has them; of a real one what the wire protocols' documents say.
struct Watchdogs {
  double frame_s = 0.5;
  double pressure_s = 0.5;
  double frame_answer_s = 0.0;  ///< what an emulated 8800 takes for an answer
};
[[nodiscard]] Watchdogs watchdogs_of(const RigConfig& rig, const base::TomlTable& root);

}  // namespace isorig::daemon
