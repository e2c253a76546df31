#include <algorithm>

#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: how a run begins, goes on and ends (docs/states.md).
namespace isorig::daemon {

void Core::open_run(std::int64_t now_ns, const Request& request) noexcept {
  plan_ = request.plan;
  step_ = plan_->sessions.empty() ? 0 : plan_->sessions[request.first_session].first_step;
  first_session_ = request.first_session;
  cursor_.emplace(*plan_);
  outcome_ = Outcome::kNone;
  run_open_ = true;
  run_begun_ = regaining_ = false;
  clear_faults();
  ++now_.runs_started;
  setpoint_psi_ = -1.0;
  supervisor_.rearm(now_ns);
  guard_.restart();
  now_.control.progress = 0.0F;
  now_.control.remaining_s = static_cast<float>(plan_->nominal_s);
  now_.sessions = static_cast<std::uint32_t>(plan_->sessions.size());
  now_.steps = static_cast<std::uint32_t>(plan_->steps.size());
}

void Core::set_off(std::int64_t now_ns) noexcept {
  if (run_begun_) {
    cursor_->resume(now_ns);
    transition(now_ns, RunState::kRunning, Severity::kInfo, "resume", "resumed by the operator", 0.0, 0.0);
    return;
  }
  run_begun_ = true;
  cursor_->start(now_ns, first_session_, static_cast<std::uint16_t>(frame_segment_id_ + 1));
  interlock_.hold_pressure.store(true, std::memory_order_release);
  transition(now_ns, RunState::kRunning, Severity::kInfo, "run.start", "protocol started", 0.0, 0.0);
}

/// Stops the frame and vents, whatever the state: nobody who asks for that is told that there is nothing to abort.
void Core::abort(std::int64_t now_ns, const char* why) noexcept {
  if (run_open_) {
    end_run(now_ns, run_begun_ ? Outcome::kAborted : Outcome::kNotStarted, why);
    return;
  }
  const std::int64_t since_ns = stopping_since_ns_;
  stop_and_vent(now_ns);
  if (state_ == RunState::kFaulted) {
    vented_fault_ = true;  // the cause stays latched
    emit(now_ns, Severity::kInfo, "abort", why, pressure_psi_, 0.0);
  } else if (state_ == RunState::kStopping || state_ == RunState::kIdle || state_ == RunState::kReady) {
    // Between runs nothing is left to end: whether the rig stays ready is what its streams say.
    if (state_ == RunState::kStopping) stopping_since_ns_ = since_ns;
    emit(now_ns, Severity::kInfo, "abort", why, pressure_psi_, 0.0);
  } else {
    clear_faults();  // of a run before
    transition(now_ns, RunState::kStopping, Severity::kInfo, "abort", why, pressure_psi_, 0.0);
  }
}

void Core::end_run(std::int64_t now_ns, Outcome outcome, const char* why) noexcept {
  outcome_ = outcome;
  run_open_ = false;
  stop_and_vent(now_ns);
  const char* code = outcome == Outcome::kDone         ? "run.done"
                     : outcome == Outcome::kAborted    ? "run.aborted"
                     : outcome == Outcome::kNotStarted ? "run.not_started"
                                                       : "run.failed";
  transition(now_ns, RunState::kStopping, Severity::kInfo, code, why, 0.0, 0.0);
}

void Core::request_stop(std::int64_t now_ns) noexcept {
  commanded_velocity_mm_s_ = 0.0;
  ++stops_requested_;
  supervisor_.on_stop(now_ns, stops_requested_);
  frame_.stops_requested.store(stops_requested_, std::memory_order_release);
}

/// For whoever waits to leave. A fault may stay latched then, and a crosshead that does not stand is stopped by the
/// frame's own watchdog by now: it gets no heartbeat. Between runs only what is seen now counts: a rig is idle, too,
/// when no device answers.
bool Core::is_stopped(std::int64_t now_ns) const noexcept {
  constexpr std::int64_t kStopPatienceNs = 2'000'000'000;
  if (run_open_ || state_ == RunState::kSetup) return false;
  if (state_ == RunState::kIdle || state_ == RunState::kReady) {
    const double frame_age_s = supervisor_.frame_age_s(now_ns), pressure_age_s = supervisor_.pressure_age_s(now_ns);
    const bool is_seen = frame_age_s >= 0.0 && frame_age_s <= config_.supervisor.frame_age_max_s &&
                         pressure_age_s >= 0.0 && pressure_age_s <= config_.supervisor.pressure_age_max_s;
    return is_seen && pressure_psi_ < config_.vented_psi && supervisor_.stands();
  }
  if (state_ != RunState::kFaulted) return false;  // it becomes idle by itself, or faulted
  const bool vented = filter_last_ns_ > stopping_since_ns_ && pressure_psi_ < config_.vented_psi;
  return vented && (supervisor_.stands() || now_ns - stopping_since_ns_ > kStopPatienceNs);
}

void Core::seal() noexcept {
  loop_.shut();
  setpoint_psi_ = -1.0;  // the plan's set-point counts again when it goes on
}

void Core::stop_and_vent(std::int64_t now_ns) noexcept {
  request_stop(now_ns);
  loop_.vent();
  setpoint_psi_ = -1.0;
  interlock_.hold_pressure.store(false, std::memory_order_release);
  jogging_ = setup_wanted_ = false;
  stopping_since_ns_ = now_ns;
}

}  // namespace isorig::daemon
