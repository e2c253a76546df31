#pragma once
#include <array>
#include <bit>
#include <cstdint>

#include "daemon/core/links.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// How a run ended; kNone while it goes on.
/// kNotStarted: its countdown was not completed.
enum class Outcome : std::uint8_t { kNone, kDone, kAborted, kFailed, kNotStarted };

/// Wake-ups by how late they came: below 1, 2, 4, ... 2^18 us, and later.
inline constexpr std::size_t kLatenessBins = 20;
[[nodiscard]] constexpr std::size_t lateness_bin(std::int64_t late_ns) noexcept {
  const auto us = static_cast<std::uint64_t>(late_ns < 0 ? 0 : late_ns) / 1000;
  const auto width = static_cast<std::size_t>(std::bit_width(us));
  return width < kLatenessBins ? width : kLatenessBins - 1;
}

/// A fault since the last reset, in the order in which they came.
struct FaultNote {
  std::int64_t mono_ns = 0;
  Severity severity = Severity::kInfo;
  char code[32] = {};
  char text[400] = {};  ///< what, the numbers, what the device's driver says
};
inline constexpr std::size_t kFaultsKept = 16;

/// 7 kB that change with a fault or a reset: apart, so that a tick does not copy them.
struct FaultList {
  std::uint32_t fault_count = 0;  ///< of `faults`; what came when it was full is not there
  std::array<FaultNote, kFaultsKept> faults{};
};

/// The loop's newest view of everything else.
struct LoopStatus {
  ControlRecord control;
  std::uint32_t session = 0;
  std::uint32_t sessions = 0;
  std::uint32_t steps = 0;
  std::int32_t repetition = 0;
  bool healthy = false;
  std::uint64_t runs_started = 0;
  bool run_loaded = false;  ///< a run is open: it can still go on
  Outcome outcome = Outcome::kNone;
  /// No run is open, and crosshead and vented actuator are seen to be at rest; with a latched fault the crosshead was
  /// given 2 s to.
  bool stopped = false;
  bool sealed = false;            ///< both valves are kept shut: the pressure is regulated by nobody
  bool vented_fault = false;      ///< the fault's reaction was the safe state
  bool zero_confirmed = false;    ///< the frame's zero, since the frame was started
  float operator_left_s = -1.0F;  ///< armed: for the second act; countdown: to the motion; setup: until it is left
  LinkHealth frame;
  LinkHealth pressure;
  LinkHealth interlock;
  clock::SyncCounts sync;        ///< the mapping of the Teensy's clock, measured by the sync line
  clock::SyncCheck sync_check;   ///< the last
  LinkHealth regulator;          ///< where one sets the pressure
  double frame_age_s = -1.0;     ///< of the newest sample; negative before the first
  double pressure_age_s = -1.0;  ///< of the newest valid reading
  bool estop_closed = false;
  bool guard_closed = false;
  std::uint64_t records_dropped = 0;  ///< by a full queue to the recorder: the run says so and fails
  std::uint64_t publish_dropped = 0;
  std::uint32_t worst_wakeup_ns = 0;  ///< since start
  std::uint32_t worst_run_ns = 0;
  std::array<std::uint64_t, kLatenessBins> lateness{};  ///< since start
  std::uint64_t invalid_pressure = 0;                   ///< sensor words that were no current reading, since start
  char not_ready[96] = {};                              ///< what is missing for ready, in words
  char fault[448] = {};                                 ///< the latched cause: the first
};

/// What `isorig status` and `watch` show.
struct Status : LoopStatus, FaultList {};

}  // namespace isorig::daemon
