#include "daemon/core/supervisor.hpp"

#include <algorithm>
#include <cmath>

#include "base/toml_reader.hpp"
#include "daemon/core/seconds.hpp"

namespace isorig::daemon {
namespace {
// In that time the frame's thread has taken up a request, and says what it makes of it.
constexpr double kRenewedMax_s = 0.1;

}  // namespace

SupervisorConfig SupervisorConfig::read(const base::TomlTable& table, const protocol::Limits& limits) {
  SupervisorConfig c;
  c.limits = limits;
  c.frame_age_max_s = table.number_or("frame_age_max_s", c.frame_age_max_s, base::kPositive);
  c.pressure_age_max_s = table.number_or("pressure_age_max_s", c.pressure_age_max_s, base::kPositive);
  c.interlock_age_max_s = table.number_or("interlock_age_max_s", c.interlock_age_max_s, base::kPositive);
  c.late_tick_max_s = table.number_or("late_tick_max_s", c.late_tick_max_s, base::kPositive);
  c.following_error_max_mm = table.number_or("following_error_max_mm", c.following_error_max_mm, base::kPositive);
  c.stop_confirm_max_s = table.number_or("stop_confirm_max_s", c.stop_confirm_max_s, {0.1, kLongestStopConfirm_s});
  c.standstill_max_mm = table.number_or("standstill_max_mm", c.standstill_max_mm, base::kPositive);
  c.segment_ack_max_s = table.number_or("segment_ack_max_s", c.segment_ack_max_s, base::kPositive);
  c.frozen_force_max_s = table.number_or("frozen_force_max_s", c.frozen_force_max_s, base::kPositive);
  c.following_error_min_mm = table.number_or("following_error_min_mm", c.following_error_min_mm, base::kPositive);
  c.break_drop_N = table.number_or("break_drop_N", c.break_drop_N, {0.0, 1e6});
  c.held_max_s = table.number_or("held_max_s", c.held_max_s, {0.0, 1e6});
  c.force_rate_window_s = table.number_or("force_rate_window_s", c.force_rate_window_s, {0.002, 0.06});
  return c;
}

Supervisor::Supervisor(const SupervisorConfig& config) noexcept
    : config_(config), force_watch_(config.force_rate_window_s, config.frozen_force_max_s) {}

void Supervisor::set_state(RunState state, bool run_open) noexcept {
  state_ = state;
  run_open_ = run_open;
  const bool after = state == RunState::kStopping || (state == RunState::kFaulted && !run_open);
  const bool between =
      state == RunState::kIdle || state == RunState::kReady || (state == RunState::kArmed && !run_open);
  phase_ = between ? Phase::kBetween : after ? Phase::kAfter : segment_moving_ ? Phase::kMoving : Phase::kHolding;
}

void Supervisor::note(const char* code, const char* what, double value, double threshold) noexcept {
  const Severity severity = severity_of(code, phase_);
  if (severity != Severity::kInfo) found_.note({severity, code, what, value, threshold});
}

void Supervisor::on_pressure_sample(std::int64_t mono_ns, double pressure_psi, bool valid) noexcept {
  if (!valid) return;  // an unusable reading does not count as one: the age limit does the rest
  pressure_age_.on_sample(mono_ns, absence_);
  if (pressure_psi > config_.limits.pressure_max_psi) {
    note("limit.pressure", "pressure above its limit; check the fill valve and the supply", pressure_psi,
         config_.limits.pressure_max_psi);
  }
}

void Supervisor::on_pressure_stuck() noexcept {
  note("pressure.frozen", "the sensor sends one and the same count; check the sensor, its wires and the Teensy", 0.0,
       0.0);
}

void Supervisor::on_regulator(std::int64_t mono_ns, double pressure_psi, double elvh_psi, bool faulty) noexcept {
  regulator_age_.on_sample(mono_ns, absence_);
  if (faulty) note("regulator.fault", "the pressure regulator reports a fault; read its own display", 0.0, 0.0);
  const double error_psi = std::abs(pressure_psi - elvh_psi);
  if (error_psi <= config_.regulator_error_max_psi) {
    disagree_since_ns_ = -1;
  } else if (disagree_since_ns_ < 0) {
    disagree_since_ns_ = mono_ns;
  } else if (seconds(mono_ns - disagree_since_ns_) > 1.0) {
    note("regulator.disagrees",
         "regulator and ELVH read different pressures; check the regulator's unit, zero and tubing", error_psi,
         config_.regulator_error_max_psi);
  }
}

void Supervisor::on_device_vented(bool is_vented, pressure::VentCause cause) noexcept {
  device_vented_ = is_vented;
  if (!is_vented) return;
  using pressure::VentCause;
  const auto vented = [&](const char* code, const char* what) { note(code, what, 0.0, 0.0); };
  switch (cause) {
    case VentCause::kPressureHigh:
      return vented(
          "teensy.pressure",
          "the Teensy read more than its greatest pressure and vented by itself; check fill valve and supply");
    case VentCause::kFillTime:
      return vented("teensy.fill_time",
                    "the Teensy had its fill valve open for longer than any filling takes and vented by itself; "
                    "check supply, hoses and the sensor's tube");
    case VentCause::kSensorSilent:
      return vented(
          "teensy.sensor",
          "the Teensy had no reading to believe while it filled and vented by itself; check the sensor and its wires");
    case VentCause::kSensorStuck:
      return vented(
          "teensy.stuck",
          "the sensor sent one and the same count while the Teensy filled, and it vented by itself; check the sensor");
    case VentCause::kNone:
    case VentCause::kHeartbeat:
      return vented("pressure.watchdog",
                    "the Teensy missed our heartbeat and vented by itself; the run is over: reset, then start again");
  }
}

void Supervisor::on_interlock(const interlock::State& state) noexcept {
  if (state.mono_ns <= interlock_age_.seen_ns()) return;
  // Open by what it is now, or by an opening since the last reading that is over: the kernel's stamp tells of it. What
  // lies before the first reading is not news.
  const bool has_seen = interlock_age_.is_seen();
  const bool estop_opened = has_seen && state.estop_opened_ns > interlock_.estop_opened_ns;
  const bool guard_opened = has_seen && state.guard_opened_ns > interlock_.guard_opened_ns;
  interlock_age_.on_sample(state.mono_ns, absence_);
  interlock_ = state;
  // How long ago it opened, where the kernel stamped it.
  const auto ago_s = [&](std::int64_t opened_ns) { return opened_ns > 0 ? seconds(state.mono_ns - opened_ns) : 0.0; };
  if (state.lost) {
    note("interlock.lost", "the interlock inputs cannot be read; check their chip and cable", 0.0, 0.0);
  } else if (!state.estop_closed) {
    note("interlock.estop", "the emergency-stop chain is open; release it, then reset", ago_s(state.estop_opened_ns),
         0.0);
  } else if (estop_opened) {
    note("interlock.estop", "the emergency-stop chain was open for a moment; find out why, then reset",
         ago_s(state.estop_opened_ns), 0.0);
  } else if (state_ == RunState::kSetup && config_.guard_open_in_setup) {
    return;
  } else if (!state.guard_closed) {
    note("interlock.guard", "the guard is open; close it, then reset", ago_s(state.guard_opened_ns), 0.0);
  } else if (guard_opened) {
    note("interlock.guard", "the guard was open for a moment; find out why, then reset", ago_s(state.guard_opened_ns),
         0.0);
  }
}

void Supervisor::on_tick_lateness(std::int64_t now_ns, std::int64_t late_ns) noexcept {
  if (seconds(late_ns) <= config_.late_tick_max_s) return;
  absence_ = {now_ns - late_ns, now_ns};
  for (auto* stream : streams()) stream->on_absence(absence_);
  if (stop_pending_) stop_since_ns_ += absence_.since(stop_since_ns_);
  note("loop.late", "the real-time loop was late; check the machine's load and priorities", seconds(late_ns),
       config_.late_tick_max_s);
}

double Supervisor::frame_age_s(std::int64_t now_ns) const noexcept {
  return frame_age_.age_s(now_ns);
}

double Supervisor::pressure_age_s(std::int64_t now_ns) const noexcept {
  return pressure_age_.age_s(now_ns);
}

const TripList& Supervisor::check(std::int64_t now_ns) noexcept {
  const auto stale = [&](const StreamAge& stream, double limit_s, const char* code, const char* what) {
    const double age_s = stream.attended_age_s(now_ns);
    if (age_s > limit_s) note(code, what, age_s, limit_s);
  };
  stale(frame_age_, config_.frame_age_max_s, "stale.frame", "no sample from the frame; check its cable and power");
  stale(pressure_age_, config_.pressure_age_max_s, "stale.pressure",
        "no valid pressure reading; check sensor, Teensy and cable");
  if (config_.regulator_age_max_s > 0.0) {
    stale(regulator_age_, config_.regulator_age_max_s, "stale.regulator",
          "the pressure regulator does not answer; check its cable and power");
  }
  stale(interlock_age_, config_.interlock_age_max_s, "stale.interlock", "the interlock inputs are not being read");
  if (segment_active_ && !segment_acknowledged_ && !stop_pending_ &&
      seconds(now_ns - segment_start_ns_) > config_.segment_ack_max_s) {
    note("frame.segment", "the frame did not take the segment; check its mode (computer control)",
         seconds(now_ns - segment_start_ns_), config_.segment_ack_max_s);
    segment_active_ = false;
  }
  if (stop_renewed_ && seconds(now_ns - stop_since_ns_) > kRenewedMax_s) stop_renewed_ = false;
  if (stop_pending_ && seconds(now_ns - stop_since_ns_) > config_.stop_confirm_max_s) {
    note("frame.stop",
         "the crosshead was told to stop and has not been seen to stand; its heartbeat is withheld. If it moves, use "
         "its own stop",
         seconds(now_ns - stop_since_ns_), config_.stop_confirm_max_s);
  }
  trips_ = found_;
  found_.clear();
  return trips_;
}

bool Supervisor::healthy(std::int64_t now_ns, const char** why, bool guard_may_be_open) const noexcept {
  const auto fresh = [&](const StreamAge& stream, double limit_s) { return stream.is_fresh(now_ns, limit_s); };
  const char* reason = nullptr;
  // The chain first: a frame whose drive it has cut reports a fault for that alone.
  if (fresh(interlock_age_, config_.interlock_age_max_s) && !interlock_.lost && !interlock_.estop_closed) {
    reason = "the emergency-stop chain is open";
  } else if (fresh(interlock_age_, config_.interlock_age_max_s) && !interlock_.lost && !interlock_.guard_closed &&
             !guard_may_be_open) {
    reason = "the guard is open";
  } else if (!fresh(frame_age_, config_.frame_age_max_s)) {
    reason = "no samples from the frame";
  } else if (number_missing_ns_ >= 0 && seconds(now_ns - number_missing_ns_) <= config_.frame_age_max_s) {
    reason = "the frame sends values that are no numbers; check its transducers";
  } else if (!frame_state_known_) {
    reason = "the frame has not reported its state";
  } else if ((frame_state_.fault_bits & frame::kInterlockOpen) != 0) {
    reason = "the frame says that its safety chain is open";
  } else if ((frame_state_.fault_bits & frame::kHeartbeatLost) != 0) {
    reason = "the frame misses our heartbeat";
  } else if ((frame_state_.fault_bits & ~frame::kSampleBufferOverrun) != 0) {
    reason = "the frame reports a fault";
  } else if (frame_state_.motion == frame::Motion::kFault) {
    reason = "the frame is in a fault state";
  } else if (stop_pending_ && !stop_renewed_) {
    reason = "the crosshead was told to stop and has not been seen to stand";
  } else if (!segment_active_ && !frame_stands_) {
    reason = "the crosshead moves";
  } else if (!fresh(pressure_age_, config_.pressure_age_max_s)) {
    reason = "no valid pressure reading";
  } else if (device_vented_) {
    reason = "the Teensy holds the vent open: it missed the heartbeat";
  } else if (force_watch_.is_frozen()) {
    reason = "the force reading does not change; check the load cell";
  } else if (config_.regulator_age_max_s > 0.0 && !fresh(regulator_age_, config_.regulator_age_max_s)) {
    reason = "the pressure regulator does not answer";
  } else if (!fresh(interlock_age_, config_.interlock_age_max_s)) {
    reason = "the interlock is not being read";
  } else if (interlock_.lost) {
    reason = "the interlock inputs cannot be read";
  }
  if (why != nullptr) *why = reason == nullptr ? "" : reason;
  return reason == nullptr;
}

void Supervisor::rearm(std::int64_t now_ns) noexcept {
  disagree_since_ns_ = -1;
  found_.clear();
  segment_active_ = segment_moving_ = false;
  arrived_ns_ = -1;
  force_watch_.restart();
  rearm_limit(travel_, last_position_mm_, travel_bounds());
  rearm_limit(force_, last_force_N_, force_bounds());
  for (auto* stream : streams()) stream->restart(now_ns);
}

}  // namespace isorig::daemon
