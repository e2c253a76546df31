#include <algorithm>

#include "daemon/core.hpp"
#include "daemon/fixed_text.hpp"

/// Core: how the operator's verbs begin, pause and end a run (docs/states.md).
namespace isorig::daemon {

void Core::take_requests(std::int64_t now_ns) noexcept {
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
      case Request::Verb::kStart:
        if (state_ != RunState::kReady) {
          refuse(state_ == RunState::kFaulted ? "reset the fault first (isorig reset)"
                 : state_ == RunState::kIdle ? std::string_view(now_.not_ready)
                                             : "a run is under way; abort it first (isorig abort)");
        } else {
          begin_run(now_ns, request);
        }
        break;
      case Request::Verb::kPause:
        if (state_ != RunState::kRunning) {
          refuse("only a running protocol can be paused");
        } else {
          cursor_->pause(now_ns);
          send_stop();
          transition(now_ns, RunState::kPaused, Severity::kInfo, "pause", "paused by the operator: frame and pressure hold",
                     0.0, 0.0);
        }
        break;
      case Request::Verb::kResume:
        if (state_ != RunState::kPaused) {
          refuse("there is nothing to resume");
        } else {
          cursor_->resume(now_ns);
          transition(now_ns, RunState::kRunning, Severity::kInfo, "resume", "resumed by the operator", 0.0, 0.0);
        }
        break;
      case Request::Verb::kAbort:
        if (state_ == RunState::kRunning || state_ == RunState::kPaused ||
            (state_ == RunState::kFaulted && run_open_)) {
          end_run(now_ns, Outcome::kAborted, "aborted by the operator: frame stops, pressure vents");
        } else {
          refuse("there is no run to abort");
        }
        break;
      case Request::Verb::kSeal:
        if (state_ != RunState::kPaused) {
          refuse("only a paused run can be sealed");
        } else {
          loop_.shut();
          setpoint_psi_ = -1.0;  // the plan's set-point counts again when it goes on
          emit(now_ns, Severity::kInfo, "sealed", "both valves shut by the operator until the run goes on", pressure_psi_, 0.0);
        }
        break;
      case Request::Verb::kCalibrate:
        if (state_ != RunState::kIdle && state_ != RunState::kReady) {
          refuse("a calibration is put in force between runs");
        } else {
          config_.calibration = request.calibration;
          emit(now_ns, Severity::kInfo, "calibration", "another calibration is in force", 0.0, 0.0);
        }
        break;
      case Request::Verb::kReset: {
        const char* why = nullptr;
        if (state_ != RunState::kFaulted) {
          refuse("there is no fault to reset");
        } else if (recorder_fault_.load(std::memory_order_acquire)) {
          refuse("the recorder cannot write; make room on the disk first");
        } else if (!supervisor_.healthy(now_ns, &why)) {
          refuse(why);
        } else {
          supervisor_.rearm(now_ns);
          now_.fault[0] = '\0';
          if (run_open_ && !vented_fault_) {
            transition(now_ns, RunState::kPaused, Severity::kInfo, "reset",
                       "fault reset; the run is paused: resume or abort it", 0.0, 0.0);
          } else {
            stop_and_vent(now_ns);
            transition(now_ns, RunState::kStopping, Severity::kInfo, "reset", "fault reset", 0.0, 0.0);
          }
        }
        break;
      }
    }
    if (reply.accepted) text << "now " << to_text(state_);
    replies.push(reply);
  }
}

void Core::begin_run(std::int64_t now_ns, const Request& request) noexcept {
  plan_ = request.plan;
  step_ = plan_->sessions.empty() ? 0 : plan_->sessions[request.first_session].first_step;
  cursor_.emplace(*plan_);
  cursor_->start(now_ns, request.first_session, static_cast<std::uint16_t>(last_segment_id_ + 1));
  outcome_ = Outcome::kNone;
  run_open_ = true;
  now_.fault[0] = '\0';
  ++now_.runs_started;
  setpoint_psi_ = -1.0;
  supervisor_.rearm(now_ns);
  interlock_.hold_pressure.store(true, std::memory_order_release);
  now_.sessions = static_cast<std::uint32_t>(plan_->sessions.size());
  now_.steps = static_cast<std::uint32_t>(plan_->steps.size());
  transition(now_ns, RunState::kRunning, Severity::kInfo, "run.start", "protocol started", 0.0, 0.0);
}

void Core::end_run(std::int64_t now_ns, Outcome outcome, const char* why) noexcept {
  outcome_ = outcome;
  run_open_ = false;
  stop_and_vent(now_ns);
  const char* code = outcome == Outcome::kDone ? "run.done" : outcome == Outcome::kAborted ? "run.aborted" : "run.failed";
  transition(now_ns, RunState::kStopping, Severity::kInfo, code, why, 0.0, 0.0);
}

void Core::send_stop() noexcept {
  commanded_velocity_mm_s_ = 0.0;
  supervisor_.on_stop();
  frame_.commands.push({FrameCommand::Kind::kStop, {}});
}

void Core::stop_and_vent(std::int64_t now_ns) noexcept {
  send_stop();
  loop_.vent();
  setpoint_psi_ = -1.0;
  interlock_.hold_pressure.store(false, std::memory_order_release);
  stopping_since_ns_ = now_ns;
}

}  // namespace isorig::daemon
