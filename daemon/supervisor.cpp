#include "daemon/supervisor.hpp"

#include <algorithm>
#include <cmath>

#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {
constexpr std::int64_t kExcuseNs = 200'000'000;

constexpr double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }
}  // namespace

SupervisorConfig SupervisorConfig::read(const base::TomlTable& table, const protocol::Limits& limits) {
  SupervisorConfig c;
  c.limits = limits;
  c.frame_age_max_s = table.number_or("frame_age_max_s", c.frame_age_max_s, base::kPositive);
  c.pressure_age_max_s = table.number_or("pressure_age_max_s", c.pressure_age_max_s, base::kPositive);
  c.interlock_age_max_s = table.number_or("interlock_age_max_s", c.interlock_age_max_s, base::kPositive);
  c.late_tick_max_s = table.number_or("late_tick_max_s", c.late_tick_max_s, base::kPositive);
  c.following_error_max_mm = table.number_or("following_error_max_mm", c.following_error_max_mm, base::kPositive);
  c.segment_ack_max_s = table.number_or("segment_ack_max_s", c.segment_ack_max_s, base::kPositive);
  c.frozen_force_max_s = table.number_or("frozen_force_max_s", c.frozen_force_max_s, base::kPositive);
  c.force_rate_window_s = table.number_or("force_rate_window_s", c.force_rate_window_s, {0.002, 0.06});
  return c;
}

Supervisor::Supervisor(const SupervisorConfig& config) noexcept : config_(config) {}

void Supervisor::note(Trip trip) noexcept {
  if (trip.severity > worst_.severity) worst_ = trip;
}

void Supervisor::on_frame_sample(const FrameRecord& s) noexcept {
  frame_seen_ns_ = std::max(frame_seen_ns_, s.mono_ns);
  const auto& l = config_.limits;
  if (!std::isfinite(s.position_mm) || !std::isfinite(s.force_N)) {
    note({Severity::kSafeState, "frame.number", "the frame sent a value that is not a number; check the register map",
          0.0, 0.0});
    return;
  }
  if (s.position_mm > l.travel_max_mm || s.position_mm < l.travel_min_mm) {
    const bool high = s.position_mm > l.travel_max_mm;
    note({Severity::kProgramStop, "limit.travel", "position outside the travel limits; check the specimen and the zero",
          s.position_mm, high ? l.travel_max_mm : l.travel_min_mm});
  }
  if (s.force_N > l.force_max_N || s.force_N < l.force_min_N) {
    const bool high = s.force_N > l.force_max_N;
    note({Severity::kProgramStop, "limit.force", "force outside its limits; check specimen, grips and load cell",
          s.force_N, high ? l.force_max_N : l.force_min_N});
  }
  // Force rate over a window, against the newest sample at least that old.
  const auto window_ns = static_cast<std::int64_t>(config_.force_rate_window_s * 1e9);
  force_history_[force_count_ % kForceHistory] = {s.mono_ns, s.force_N};
  ++force_count_;
  const std::size_t reach = std::min(force_count_, kForceHistory);
  for (std::size_t back = 2; back <= reach; ++back) {
    const auto& old = force_history_[(force_count_ - back) % kForceHistory];
    const std::int64_t span_ns = s.mono_ns - old.mono_ns;
    if (span_ns < window_ns) continue;
    const double rate = std::abs(s.force_N - old.force_N) / seconds(span_ns);
    if (rate > l.force_rate_max_N_s) {
      note({Severity::kProgramStop, "limit.force_rate", "force changes too fast; a slip, a burst or a loose grip", rate,
            l.force_rate_max_N_s});
    }
    break;
  }
  if (s.raw_force_N != same_force_N_ || same_force_since_ns_ < 0 || !segment_moving_) {
    same_force_N_ = s.raw_force_N;
    same_force_since_ns_ = s.mono_ns;
  } else if (seconds(s.mono_ns - same_force_since_ns_) > config_.frozen_force_max_s) {
    // The noise of a load cell moves its last digit many times a second; a moving specimen all the more.
    note({Severity::kProgramStop, "force.frozen", "the force reading does not change while the crosshead moves; check the load cell",
          seconds(s.mono_ns - same_force_since_ns_), config_.frozen_force_max_s});
  }
  if (segment_active_ && segment_acknowledged_) {
    // Where the crosshead may be: between standing still for the permitted error and having run the whole segment.
    const double elapsed_s = std::max(0.0, seconds(s.mono_ns - segment_start_ns_));
    const double length = double{segment_.target_mm} - segment_from_mm_;
    const double done = std::min(std::abs(length), double{segment_.velocity_mm_s} * elapsed_s);
    const double expected = segment_from_mm_ + std::copysign(done, length);
    if (std::abs(double{s.raw_position_mm} - expected) >
        config_.following_error_max_mm + 0.05 * double{segment_.velocity_mm_s}) {
      note({Severity::kProgramStop, "frame.following", "the crosshead does not follow its segment; check drive and speed",
            double{s.raw_position_mm}, expected});
    }
  }
}

void Supervisor::on_frame_report(const frame::State& state) noexcept {
  frame_state_ = state;
  frame_state_known_ = true;
  segment_moving_ = segment_active_ && state.segment_id == segment_.id && state.motion == frame::Motion::kMoving;
  if (state.fault_bits != 0) {
    if (state.fault_bits & frame::kInterlockOpen) {
      note({Severity::kSafeState, "interlock.frame", "the frame says its safety chain is open; close it, then reset",
            double(state.fault_bits), 0.0});
    } else if (state.fault_bits & frame::kHeartbeatLost) {
      note({Severity::kSafeState, "frame.heartbeat", "the frame missed our heartbeat and stopped by itself; reset",
            double(state.fault_bits), 0.0});
    } else if (state.fault_bits & ~frame::kSampleBufferOverrun) {
      note({Severity::kSafeState, "frame.fault", "the frame reports a fault; read its own display, then reset",
            double(state.fault_bits), 0.0});
    }
  }
  if (segment_active_ && segment_acknowledged_ && state.segment_id == segment_.id &&
      (state.motion == frame::Motion::kStopped || state.motion == frame::Motion::kLimit ||
       state.motion == frame::Motion::kDisabled)) {
    note({Severity::kProgramStop, "frame.stopped",
          "the frame stopped short of its target, and not because we said so; look at its display, then reset and resume",
          0.0, double{segment_.target_mm}});
    segment_active_ = false;
  }
  if (segment_active_ && !segment_acknowledged_ && state.segment_id == segment_.id) {
    segment_acknowledged_ = true;
    if (std::abs(state.target_mm - segment_.target_mm) > 1e-3F ||
        std::abs(state.velocity_mm_s - segment_.velocity_mm_s) > 1e-3F * segment_.velocity_mm_s) {
      note({Severity::kProgramStop, "frame.segment", "the frame echoes another target or velocity than was sent",
            double{state.target_mm}, double{segment_.target_mm}});
    }
  }
}

void Supervisor::on_pressure_sample(std::int64_t mono_ns, double pressure_psi, bool valid) noexcept {
  if (!valid) return;  // an unusable reading does not count as one: the age limit does the rest
  pressure_seen_ns_ = std::max(pressure_seen_ns_, mono_ns);
  if (pressure_psi > config_.limits.pressure_max_psi) {
    note({Severity::kSafeState, "limit.pressure", "pressure above its limit; check the fill valve and the supply",
          pressure_psi, config_.limits.pressure_max_psi});
  }
}

void Supervisor::on_pressure_stuck() noexcept {
  note({Severity::kSafeState, "pressure.frozen", "the sensor sends one and the same count; check the sensor, its wires and the Teensy", 0.0,
        0.0});
}

void Supervisor::on_regulator(std::int64_t mono_ns, double pressure_psi, double elvh_psi, bool faulty) noexcept {
  regulator_seen_ns_ = std::max(regulator_seen_ns_, mono_ns);
  if (faulty) note({Severity::kSafeState, "regulator.fault", "the pressure regulator reports a fault; read its own display", 0.0, 0.0});
  const double error_psi = std::abs(pressure_psi - elvh_psi);
  if (error_psi <= config_.regulator_error_max_psi) {
    disagree_since_ns_ = -1;
  } else if (disagree_since_ns_ < 0) {
    disagree_since_ns_ = mono_ns;
  } else if (seconds(mono_ns - disagree_since_ns_) > 1.0) {
    note({Severity::kSafeState, "regulator.disagrees",
          "regulator and ELVH read different pressures; check the regulator's unit, zero and tubing", error_psi,
          config_.regulator_error_max_psi});
  }
}

void Supervisor::on_device_vented() noexcept {
  note({Severity::kSafeState, "pressure.watchdog", "the Teensy missed our heartbeat and vented by itself; reset", 0.0,
        0.0});
}

void Supervisor::on_interlock(const interlock::State& state) noexcept {
  if (state.mono_ns <= interlock_seen_ns_) return;
  interlock_seen_ns_ = state.mono_ns;
  interlock_ = state;
  // How long ago it opened, where the kernel stamped it.
  const double open_s = state.opened_ns > 0 ? seconds(state.mono_ns - state.opened_ns) : 0.0;
  if (state.lost) {
    note({Severity::kSafeState, "interlock.lost", "the interlock inputs cannot be read; check their chip and cable", 0.0,
          0.0});
  } else if (!state.estop_closed) {
    note({Severity::kSafeState, "interlock.estop", "the emergency-stop chain is open; release it, then reset", open_s, 0.0});
  } else if (!state.guard_closed) {
    note({Severity::kSafeState, "interlock.guard", "the guard is open; close it, then reset", open_s, 0.0});
  }
}

void Supervisor::on_tick_lateness(std::int64_t now_ns, std::int64_t late_ns) noexcept {
  if (seconds(late_ns) > config_.late_tick_max_s) {
    // What is old now is old because we were away: the cause is ours, and the streams are judged once they had
    // the time to come in.
    excused_until_ns_ = now_ns + kExcuseNs;
    note({Severity::kProgramStop, "loop.late", "the real-time loop was late; check the machine's load and priorities",
          seconds(late_ns), config_.late_tick_max_s});
  }
}

void Supervisor::on_segment(const frame::Segment& segment, double from_mm, std::int64_t mono_ns) noexcept {
  segment_active_ = true;
  segment_acknowledged_ = false;
  segment_ = segment;
  segment_from_mm_ = from_mm;
  segment_start_ns_ = mono_ns;
}

void Supervisor::on_stop() noexcept { segment_active_ = false; }

double Supervisor::frame_age_s(std::int64_t now_ns) const noexcept {
  return frame_seen_ns_ < 0 ? -1.0 : seconds(now_ns - frame_seen_ns_);
}

double Supervisor::pressure_age_s(std::int64_t now_ns) const noexcept {
  return pressure_seen_ns_ < 0 ? -1.0 : seconds(now_ns - pressure_seen_ns_);
}

Trip Supervisor::check(std::int64_t now_ns) noexcept {
  const auto stale = [&](std::int64_t seen_ns, double limit_s, const char* code, const char* what) {
    if (seen_ns >= 0 && now_ns >= excused_until_ns_ && seconds(now_ns - seen_ns) > limit_s) {
      note({Severity::kSafeState, code, what, seconds(now_ns - seen_ns), limit_s});
    }
  };
  stale(frame_seen_ns_, config_.frame_age_max_s, "stale.frame", "no sample from the frame; check its cable and power");
  stale(pressure_seen_ns_, config_.pressure_age_max_s, "stale.pressure",
        "no valid pressure reading; check sensor, Teensy and cable");
  if (config_.regulator_age_max_s > 0.0) {
    stale(regulator_seen_ns_, config_.regulator_age_max_s, "stale.regulator",
          "the pressure regulator does not answer; check its cable and power");
  }
  stale(interlock_seen_ns_, config_.interlock_age_max_s, "stale.interlock", "the interlock inputs are not being read");
  if (segment_active_ && !segment_acknowledged_ &&
      seconds(now_ns - segment_start_ns_) > config_.segment_ack_max_s) {
    note({Severity::kProgramStop, "frame.segment", "the frame did not take the segment; check its mode (computer control)",
          seconds(now_ns - segment_start_ns_), config_.segment_ack_max_s});
    segment_active_ = false;
  }
  const Trip trip = worst_;
  worst_ = {};
  return trip;
}

bool Supervisor::healthy(std::int64_t now_ns, const char** why) const noexcept {
  const auto fresh = [&](std::int64_t seen_ns, double limit_s) {
    return seen_ns >= 0 && seconds(now_ns - seen_ns) <= limit_s;
  };
  const char* reason = nullptr;
  if (!fresh(frame_seen_ns_, config_.frame_age_max_s)) {
    reason = "no samples from the frame";
  } else if (!frame_state_known_) {
    reason = "the frame has not reported its state";
  } else if ((frame_state_.fault_bits & ~frame::kSampleBufferOverrun) != 0) {
    reason = "the frame reports a fault";
  } else if (!fresh(pressure_seen_ns_, config_.pressure_age_max_s)) {
    reason = "no valid pressure reading";
  } else if (config_.regulator_age_max_s > 0.0 && !fresh(regulator_seen_ns_, config_.regulator_age_max_s)) {
    reason = "the pressure regulator does not answer";
  } else if (!fresh(interlock_seen_ns_, config_.interlock_age_max_s)) {
    reason = "the interlock is not being read";
  } else if (interlock_.lost) {
    reason = "the interlock inputs cannot be read";
  } else if (!interlock_.estop_closed) {
    reason = "the emergency-stop chain is open";
  } else if (!interlock_.guard_closed) {
    reason = "the guard is open";
  }
  if (why != nullptr) *why = reason == nullptr ? "" : reason;
  return reason == nullptr;
}

void Supervisor::rearm(std::int64_t now_ns) noexcept {
  same_force_since_ns_ = -1;
  disagree_since_ns_ = -1;
  worst_ = {};
  segment_active_ = false;
  force_count_ = 0;
  for (auto* seen : {&frame_seen_ns_, &pressure_seen_ns_, &interlock_seen_ns_, &regulator_seen_ns_}) {
    if (*seen >= 0) *seen = std::max(*seen, now_ns);
  }
}

}  // namespace isorig::daemon
