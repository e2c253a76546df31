#pragma once
#include <cstdint>

#include "drivers/api/clock.hpp"
#include "drivers/clock_map/sync_check.hpp"
#include "protocol/plan.hpp"

/// What the real-time core hands to the recorder and the publisher: plain values, each through its own
/// wait-free queue (daemon/core/streams.hpp). Fixed size, no pointers, no destructors.
namespace isorig::daemon {

using protocol::Keep;  ///< per sample, as the plan's recording policy has it

/// After a stop (program stop or safe state) everything is kept in full for so long.
inline constexpr double kEvidence_s = 2.0;

/// The step of what happens outside a run; -1 in the messages.
inline constexpr std::uint32_t kNoStep = 0xFFFF'FFFF;

struct FrameRecord {
  std::int64_t mono_ns = 0;
  std::int64_t device_us = 0;
  std::uint32_t sequence = 0;
  std::uint32_t step = 0;         ///< index into the plan; kNoStep outside a run
  float bound_ns = 0.0F;          ///< the stamp's error is inside +- this (contains path asymmetry)
  float repeatability_ns = 0.0F;  ///< one sigma of the stamp's scatter
  float raw_position_mm = 0.0F;   ///< as the frame sent it
  float raw_force_N = 0.0F;
  double position_mm = 0.0;  ///< calibrated, relative to the unpressurized rest length
  double force_N = 0.0;      ///< calibrated
  Keep keep = Keep::kFull;
};

struct PressureRecord {
  std::int64_t mono_ns = 0;
  std::int64_t device_us = 0;
  std::uint32_t sequence = 0;
  std::uint32_t step = 0;
  float bound_ns = 0.0F;
  float repeatability_ns = 0.0F;
  std::uint32_t raw_word = 0;  ///< the sensor's 32 bits
  std::uint8_t status = 0;     ///< decoded: messages/elvh.hpp
  Keep keep = Keep::kFull;
  float temperature_C = 0.0F;
  double pressure_psi = 0.0;  ///< calibrated, gauge
};

enum class RunState : std::uint8_t {
  kIdle,
  kReady,
  kRunning,
  kPaused,
  kStopping,
  kFaulted,
  kArmed,
  kCountdown,
  kSetup
};

constexpr const char* to_text(RunState state) noexcept {
  switch (state) {
    case RunState::kIdle:
      return "idle";
    case RunState::kReady:
      return "ready";
    case RunState::kRunning:
      return "running";
    case RunState::kPaused:
      return "paused";
    case RunState::kStopping:
      return "stopping";
    case RunState::kFaulted:
      return "faulted";
    case RunState::kArmed:
      return "armed";
    case RunState::kCountdown:
      return "countdown";
    case RunState::kSetup:
      return "setup";
  }
  return "unknown";
}

/// The controller and the loop's own health, at the control rate (100 Hz).
struct ControlRecord {
  std::int64_t mono_ns = 0;
  std::uint32_t step = 0;
  RunState state = RunState::kIdle;
  float setpoint_psi = 0.0F;
  float pressure_psi = 0.0F;
  std::uint16_t fill_permille = 0;
  std::uint16_t vent_permille = 0;
  float target_mm = 0.0F;
  float velocity_mm_s = 0.0F;
  float position_mm = 0.0F;
  float force_N = 0.0F;
  std::uint64_t ticks = 0;
  std::uint64_t overruns = 0;
  std::uint32_t worst_wakeup_ns = 0;  ///< since the last ControlRecord
  std::uint32_t worst_run_ns = 0;     ///< since the last ControlRecord
  float progress = 0.0F;              ///< 0..1 of the plan's estimated time
  float remaining_s = 0.0F;
};

enum class Severity : std::uint8_t { kInfo, kWarning, kProgramStop, kSafeState };

constexpr const char* to_text(Severity severity) noexcept {
  switch (severity) {
    case Severity::kInfo:
      return "info";
    case Severity::kWarning:
      return "warning";
    case Severity::kProgramStop:
      return "program stop";
    case Severity::kSafeState:
      return "safe state";
  }
  return "unknown";
}

/// Of who asked for what happened.
inline constexpr std::size_t kByBytes = 96;

/// Something happened: a transition with its cause, a step, a mark, a fault, a lost sample.
struct EventRecord {
  std::int64_t mono_ns = 0;
  std::uint32_t step = 0;
  Severity severity = Severity::kInfo;
  RunState from = RunState::kIdle;
  RunState to = RunState::kIdle;
  char code[32] = {};      ///< stable name for machines: "step", "mark", "limit.force", "stale.frame", ...
  char text[400] = {};     ///< for people: what happened, the value, the threshold, what to do
  double value = 0.0;      ///< what was measured, where that makes sense
  double threshold = 0.0;  ///< what it was compared with
  char by[kByBytes] = {};  ///< who asked for it, by his socket's credentials; in the text, too. Empty: nobody
};

enum class DeviceId : std::uint8_t { kFrame, kPressure };

/// A time exchange, kept raw so that the mapping can be done again offline.
struct ExchangeRecord {
  DeviceId device = DeviceId::kFrame;
  clock::Exchange exchange;
};

/// The clock mapping measured by the sync line.
struct SyncRecord {
  std::int64_t mono_ns = 0;  ///< when both sides had come
  clock::SyncCheck check;
  clock::SyncCounts counts;
};

}  // namespace isorig::daemon
