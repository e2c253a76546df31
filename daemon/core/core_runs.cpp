#include <algorithm>

#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: how the operator's verbs begin, pause and end a run (docs/states.md).
namespace isorig::daemon {

void Core::take_requests(std::int64_t now_ns) noexcept {
  HostNote note;
  while (notes.pop(note)) emit(now_ns, note.severity, note.code, note.text, 0.0, 0.0);
  Request request;
  while (requests.pop(request)) {
    Reply reply;
    reply.id = request.id;
    reply.accepted = true;
    FixedText text(reply.text);
    const auto refuse = [&](std::string_view why) {
      reply.accepted = false;
      text << "the rig is " << to_text(state_) << ": " << why;
    };
    switch (request.verb) {
      case Request::Verb::kArm:
      case Request::Verb::kStart:
        if (state_ != RunState::kReady) {
          refuse(state_ == RunState::kFaulted ? "reset the fault first (isorig reset)"
                 : state_ == RunState::kIdle  ? std::string_view(now_.not_ready)
                                              : "a run is under way; abort it first (isorig abort)");
        } else if (const char* missing = why_not_ready(now_ns)) {
          refuse(missing);  // since the last tick
        } else if (request.verb == Request::Verb::kArm) {
          arm(now_ns);
        } else if (config_.operating.arming_required) {
          refuse("this rig has to be armed first ([operator] arming)");
        } else {
          open_run(now_ns, request);
          set_off(now_ns);
        }
        break;
      case Request::Verb::kPause:
        if (state_ == RunState::kArmed || state_ == RunState::kCountdown) {
          stand_down(now_ns, Severity::kInfo, "disarmed", "taken back by the operator");
        } else if (state_ == RunState::kSetup && jogging_) {
          end_jog(now_ns, Severity::kInfo, "jog.stopped", "the jog was stopped by the operator", seen_.position_mm,
                  0.0);
        } else if (state_ != RunState::kRunning) {
          refuse("only a running protocol, a countdown or a jog can be paused");
        } else {
          cursor_->pause(now_ns);
          wish_stop(now_ns);
          transition(now_ns, RunState::kPaused, Severity::kInfo, "pause",
                     "paused by the operator: frame and pressure hold", 0.0, 0.0);
        }
        break;
      case Request::Verb::kResume:
        if (state_ != RunState::kPaused) {
          refuse("there is nothing to resume");
        } else if (!supervisor_.stands()) {
          refuse("the crosshead has not been seen to stand yet; try again in a moment");
        } else if (config_.operating.arming_required) {
          arm(now_ns);
        } else {
          set_off(now_ns);
        }
        break;
      case Request::Verb::kGo:
        if (const char* why = count_down(now_ns, request)) refuse(why);
        break;
      case Request::Verb::kSetup:
        if (state_ != RunState::kIdle && state_ != RunState::kReady) {
          refuse("setup is entered between runs");
        } else if (const char* why = why_no_setup(now_ns)) {
          refuse(why);
        } else {
          enter_setup(now_ns, "setup: the crosshead may be jogged, at reduced speed and force");
        }
        break;
      case Request::Verb::kLeaveSetup:
        if (state_ != RunState::kSetup) {
          refuse("it is not in setup");
        } else {
          leave_setup(now_ns, Severity::kInfo, "setup.off", "setup is left by the operator");
        }
        break;
      case Request::Verb::kJog:
        if (const char* why = jog(now_ns, request)) refuse(why);
        break;
      case Request::Verb::kAbort:
        abort(now_ns);
        break;
      case Request::Verb::kSeal:
        if (state_ != RunState::kPaused) {
          refuse("only a paused run can be sealed");
        } else {
          seal();
          emit(now_ns, Severity::kInfo, "sealed", "both valves shut by the operator until the run goes on",
               pressure_psi_, 0.0);
        }
        break;
      case Request::Verb::kCalibrate:
        if (state_ != RunState::kIdle && state_ != RunState::kReady) {
          refuse("a calibration is put in force between runs");
        } else {
          config_.calibration = request.calibration;
          supervisor_.on_calibration();
          emit(now_ns, Severity::kInfo, "calibration", "another calibration is in force", 0.0, 0.0);
        }
        break;
      case Request::Verb::kConfirmZero:
        if (state_ != RunState::kIdle && state_ != RunState::kReady && (state_ != RunState::kFaulted || run_open_)) {
          refuse("the zero is confirmed between runs");
        } else if (zero_epoch_ == 0 || !frame_health_.connected) {
          refuse("the frame has not said anything yet");
        } else {
          confirmed_zero_ = zero_epoch_;
          emit(now_ns, Severity::kInfo, "zero.confirmed",
               "the operator confirms the frame's zero; position as it reads now", seen_.position_mm, 0.0);
        }
        break;
      case Request::Verb::kReset: {
        const char* why = nullptr;
        if (state_ != RunState::kFaulted) {
          refuse("there is no fault to reset");
        } else if (const Trip recorder = judge_recorder(now_ns)) {
          refuse(recorder.what);
        } else if (!supervisor_.healthy(now_ns, &why)) {
          refuse(why);
        } else {
          supervisor_.rearm(now_ns);
          guard_.restart();
          now_.fault[0] = '\0';
          now_.fault_count = 0;
          if (run_open_ && !vented_fault_) {
            transition(now_ns, RunState::kPaused, Severity::kInfo, "reset",
                       "fault reset; the run is paused: resume or abort it", 0.0, 0.0);
          } else {
            stop_and_vent(now_ns);
            setup_wanted_ = true;
            transition(now_ns, RunState::kStopping, Severity::kInfo, "reset", "fault reset", 0.0, 0.0);
          }
        }
        break;
      }
    }
    if (reply.accepted) text << "now " << to_text(state_);
    if (state_ == RunState::kArmed)
      text << ": isorig go within " << static_cast<std::int64_t>(config_.operating.arm_window_s)
           << " s begins the countdown";
    if (state_ == RunState::kCountdown)
      text << ": keep clear, the rig moves in " << static_cast<std::int64_t>(config_.operating.countdown_s) << " s";
    replies.push(reply);
  }
  const bool is_wanted = abort_wanted_.exchange(false, std::memory_order_acq_rel);
  if (is_wanted && state_ == RunState::kFaulted && !run_open_) {
    stop_and_vent(now_ns);  // the cause stays latched: it would only trip again
    vented_fault_ = true;
  } else if (is_wanted && state_ != RunState::kIdle && state_ != RunState::kReady && state_ != RunState::kStopping) {
    end_run(now_ns,
            !run_open_   ? outcome_
            : run_begun_ ? Outcome::kAborted
                         : Outcome::kNotStarted,
            "aborted from outside: frame stops, pressure vents");
  }
}

void Core::open_run(std::int64_t now_ns, const Request& request) noexcept {
  plan_ = request.plan;
  step_ = plan_->sessions.empty() ? 0 : plan_->sessions[request.first_session].first_step;
  first_session_ = request.first_session;
  cursor_.emplace(*plan_);
  outcome_ = Outcome::kNone;
  run_open_ = true;
  run_begun_ = false;
  now_.fault[0] = '\0';
  now_.fault_count = 0;
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
void Core::abort(std::int64_t now_ns) noexcept {
  constexpr const char* kWhat = "aborted by the operator: frame stops, pressure vents";
  if (run_open_) {
    end_run(now_ns, run_begun_ ? Outcome::kAborted : Outcome::kNotStarted, kWhat);
    return;
  }
  const std::int64_t since_ns = stopping_since_ns_;
  stop_and_vent(now_ns);
  if (state_ == RunState::kFaulted) {
    vented_fault_ = true;  // the cause stays latched
    emit(now_ns, Severity::kInfo, "abort", kWhat, pressure_psi_, 0.0);
  } else if (state_ == RunState::kStopping || state_ == RunState::kIdle || state_ == RunState::kReady) {
    // Between runs nothing is left to end: whether the rig stays ready is what its streams say.
    if (state_ == RunState::kStopping) stopping_since_ns_ = since_ns;
    emit(now_ns, Severity::kInfo, "abort", kWhat, pressure_psi_, 0.0);
  } else {
    transition(now_ns, RunState::kStopping, Severity::kInfo, "abort", kWhat, pressure_psi_, 0.0);
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

void Core::wish_stop(std::int64_t now_ns) noexcept {
  commanded_velocity_mm_s_ = 0.0;
  ++stops_wanted_;
  supervisor_.on_stop(now_ns, stops_wanted_);
  frame_.stops_wanted.store(stops_wanted_, std::memory_order_release);
}

/// For whoever waits to leave. A fault may stay latched then, and a crosshead that does not stand is stopped by the
/// frame's own watchdog by now: it gets no heartbeat.
bool Core::is_stopped(std::int64_t now_ns) const noexcept {
  constexpr std::int64_t kStopPatienceNs = 2'000'000'000;
  if (run_open_ || state_ == RunState::kSetup) return false;
  if (state_ == RunState::kIdle || state_ == RunState::kReady) return true;
  const bool vented = filter_last_ns_ > stopping_since_ns_ && pressure_psi_ < config_.vented_psi;
  return vented && (supervisor_.stands() || now_ns - stopping_since_ns_ > kStopPatienceNs);
}

void Core::seal() noexcept {
  loop_.shut();
  setpoint_psi_ = -1.0;  // the plan's set-point counts again when it goes on
}

void Core::stop_and_vent(std::int64_t now_ns) noexcept {
  wish_stop(now_ns);
  loop_.vent();
  setpoint_psi_ = -1.0;
  interlock_.hold_pressure.store(false, std::memory_order_release);
  jogging_ = setup_wanted_ = false;
  stopping_since_ns_ = now_ns;
}

}  // namespace isorig::daemon
