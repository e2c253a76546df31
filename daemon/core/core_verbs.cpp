#include <algorithm>

#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: the operator's verbs. Each says why it is refused, or returns nullptr and is done (docs/states.md).
namespace isorig::daemon {

void Core::take_requests(std::int64_t now_ns) noexcept {
  if (notes.size() > 0) {  // else no 200 bytes are made ready for nothing, each tick
    HostNote note;
    while (notes.pop(note)) emit(now_ns, note.severity, note.code, note.text, 0.0, 0.0);
  }
  if (requests.size() > 0) {
    Request request;
    while (requests.pop(request)) {
      const Reply reply = answer(now_ns, request);
      if (answered_count_ == answered_.size()) {  // more than the queue holds came in one tick
        replies.push(reply);
      } else {
        answered_[answered_count_++] = reply;
      }
    }
    next_control_ns_ = now_ns;
  }
  const bool is_wanted =
      abort_wanted_.load(std::memory_order_relaxed) && abort_wanted_.exchange(false, std::memory_order_acq_rel);
  if (is_wanted && state_ == RunState::kFaulted && !run_open_) {
    stop_and_vent(now_ns);  // the cause stays latched: it would only trip again
    vented_fault_ = true;
  } else if (is_wanted && state_ != RunState::kIdle && state_ != RunState::kReady && state_ != RunState::kStopping) {
    abort(now_ns, "aborted from outside: frame stops, pressure vents");
  }
}

void Core::withdraw(std::uint32_t request) noexcept {
  const auto place = withdrawals_.fetch_add(1, std::memory_order_relaxed) % withdrawn_.size();
  withdrawn_[place].store(request, std::memory_order_release);
}

bool Core::take_withdrawal(const Request& request) noexcept {
  if (merely_stops(request.verb) || request.id == 0) return false;
  return std::any_of(withdrawn_.begin(), withdrawn_.end(), [&](std::atomic<std::uint32_t>& withdrawn) {
    auto number = request.id;
    return withdrawn.compare_exchange_strong(number, 0, std::memory_order_acq_rel);
  });
}

Reply Core::answer(std::int64_t now_ns, const Request& request) noexcept {
  by_ = request.by;
  const char* refusal = nullptr;
  if (take_withdrawal(request)) {
    refusal = "the loop came to it too late: whoever asked was told that there is no answer";
    emit(now_ns, Severity::kWarning, "request.late",
         "what an operator asked for was not begun: the loop came to it after its time", 0.0, 0.0);
  } else {
    refusal = carry_out(now_ns, request);
  }
  by_ = "";
  Reply reply;
  reply.id = request.id;
  reply.accepted = refusal == nullptr;
  FixedText text(reply.text);
  if (refusal == nullptr) {
    text << "now " << to_text(state_);
  } else {
    text << "the rig is " << to_text(state_) << ": " << std::string_view(refusal);
  }
  if (refusal == nullptr && state_ == RunState::kPaused && !supervisor_.stands())
    text << ": the crosshead is told to stop, and has not been seen to stand yet; if it does not, that is the fault "
            "frame.stop";
  if (state_ == RunState::kArmed)
    text << ": isorig go within " << static_cast<std::int64_t>(config_.operating.arm_window_s)
         << " s begins the countdown";
  if (state_ == RunState::kCountdown)
    text << ": keep clear, the rig moves in " << static_cast<std::int64_t>(config_.operating.countdown_s) << " s";
  return reply;
}

const char* Core::carry_out(std::int64_t now_ns, const Request& request) noexcept {
  switch (request.verb) {
    case Request::Verb::kArm:
    case Request::Verb::kStart:
      return start(now_ns, request);
    case Request::Verb::kPause:
      return pause(now_ns);
    case Request::Verb::kResume:
      return resume(now_ns);
    case Request::Verb::kGo:
      return count_down(now_ns, request);
    case Request::Verb::kSetup:
      return set_up(now_ns);
    case Request::Verb::kLeaveSetup:
      if (state_ != RunState::kSetup) return "it is not in setup";
      leave_setup(now_ns, Severity::kInfo, "setup.off", "setup is left by the operator");
      return nullptr;
    case Request::Verb::kJog:
      return jog(now_ns, request);
    case Request::Verb::kAbort:
      abort(now_ns, "aborted by the operator: frame stops, pressure vents");
      return nullptr;
    case Request::Verb::kGiveUp:
      if (state_ != RunState::kFaulted || !run_open_) return "no fault holds a run";
      end_run(now_ns, run_begun_ ? Outcome::kFailed : Outcome::kNotStarted,
              "stopped by a fault that nobody is there to clear: frame stops, pressure vents");
      return nullptr;
    case Request::Verb::kSeal:
      if (state_ != RunState::kPaused) return "only a paused run can be sealed";
      seal();
      emit(now_ns, Severity::kInfo, "sealed", "both valves shut by the operator until the run goes on", pressure_psi_,
           0.0);
      return nullptr;
    case Request::Verb::kCalibrate:
      if (state_ != RunState::kIdle && state_ != RunState::kReady) return "a calibration is put in force between runs";
      if (request.fill_limits.pressure_max_psi > 0.0 && !pressure_.limits.push(request.fill_limits))
        return "the pressure device's thread takes no limits: it hangs";
      config_.calibration = request.calibration;
      supervisor_.on_calibration();
      guard_.restart();
      emit(now_ns, Severity::kInfo, "calibration", "another calibration is in force", 0.0, 0.0);
      return nullptr;
    case Request::Verb::kConfirmZero:
      return confirm_zero(now_ns);
    case Request::Verb::kReset:
      return reset(now_ns);
  }
  return "the loop does not know this verb";
}

const char* Core::start(std::int64_t now_ns, const Request& request) noexcept {
  if (state_ == RunState::kFaulted) return "reset the fault first (isorig reset)";
  if (state_ == RunState::kIdle) return now_.not_ready;
  if (state_ != RunState::kReady) return "a run is under way; abort it first (isorig abort)";
  if (const char* missing = why_not_ready(now_ns)) return missing;  // since the last tick
  if (request.verb == Request::Verb::kArm) {
    arm(now_ns);
    return nullptr;
  }
  if (config_.operating.arming_required) return "this rig has to be armed first ([operator] arming)";
  open_run(now_ns, request);
  set_off(now_ns);
  return nullptr;
}

const char* Core::pause(std::int64_t now_ns) noexcept {
  if (state_ == RunState::kArmed || state_ == RunState::kCountdown) {
    stand_down(now_ns, Severity::kInfo, "disarmed", "taken back by the operator");
    return nullptr;
  }
  if (state_ == RunState::kSetup && jogging_) {
    end_jog(now_ns, Severity::kInfo, "jog.stopped", "the jog was stopped by the operator", seen_.position_mm, 0.0);
    return nullptr;
  }
  if (state_ != RunState::kRunning) return "only a running protocol, a countdown or a jog can be paused";
  cursor_->pause(now_ns);
  request_stop(now_ns);
  transition(now_ns, RunState::kPaused, Severity::kInfo, "pause",
             "paused by the operator: the frame is to stop and hold, the pressure is held", 0.0, 0.0);
  return nullptr;
}

const char* Core::resume(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kPaused) return "there is nothing to resume";
  if (!supervisor_.stands()) return "the crosshead has not been seen to stand yet; try again in a moment";
  if (config_.operating.arming_required) {
    arm(now_ns);
  } else {
    set_off(now_ns);
  }
  return nullptr;
}

const char* Core::set_up(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kIdle && state_ != RunState::kReady) return "setup is entered between runs";
  if (const char* why = why_no_setup(now_ns)) return why;
  enter_setup(now_ns, "setup: the crosshead may be jogged, at reduced speed and force");
  return nullptr;
}

const char* Core::confirm_zero(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kIdle && state_ != RunState::kReady && (state_ != RunState::kFaulted || run_open_))
    return "the zero is confirmed between runs";
  if (zero_epoch_ == 0 || !now_.frame.connected) return "the frame has not said anything yet";
  confirmed_zero_ = zero_epoch_;
  emit(now_ns, Severity::kInfo, "zero.confirmed", "the operator confirms the frame's zero; position as it reads now",
       seen_.position_mm, 0.0);
  return nullptr;
}

const char* Core::reset(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kFaulted) return "there is no fault to reset";
  if (const Trip recorder = judge_recorder(now_ns)) return recorder.what;
  if (const char* why = nullptr; !supervisor_.healthy(now_ns, &why)) return why;
  supervisor_.rearm(now_ns);
  guard_.restart();
  clear_faults();
  if (run_open_ && !vented_fault_) {
    transition(now_ns, RunState::kPaused, Severity::kInfo, "reset",
               "fault reset; the run is paused: resume or abort it", 0.0, 0.0);
  } else {
    stop_and_vent(now_ns);
    setup_wanted_ = true;
    transition(now_ns, RunState::kStopping, Severity::kInfo, "reset", "fault reset", 0.0, 0.0);
  }
  return nullptr;
}

}  // namespace isorig::daemon
