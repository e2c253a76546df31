#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: transitions and steps as events, to the recorder, the publisher and the host.
namespace isorig::daemon {
namespace {

/// Into the text as well, which is what the recording keeps.
void tell_who(EventRecord& event, std::string_view text, const char* by) noexcept {
  if (by[0] == '\0') return copy_text(event.text, text);
  copy_text(event.by, by);
  FixedText(event.text) << text << ", by " << std::string_view(by);
}

}  // namespace

void Core::transition(std::int64_t now_ns, RunState to, Severity severity, const char* code, const char* text,
                      double value, double threshold) noexcept {
  EventRecord event;
  event.mono_ns = now_ns;
  // A run's first and last transition belong to it.
  event.step = to == RunState::kRunning ? step_ : step_now();
  event.severity = severity;
  event.from = state_;
  event.to = to;
  copy_text(event.code, code);
  tell_who(event, text, by_);
  event.value = value;
  event.threshold = threshold;
  state_ = to;
  next_control_ns_ = now_ns;  // the new state shows at once
  emit(event);
}

void Core::emit(std::int64_t now_ns, Severity severity, const char* code, std::string_view text, double value,
                double threshold) noexcept {
  emit_of(step_now(), now_ns, severity, code, text, value, threshold);
}

void Core::emit_of(std::uint32_t step, std::int64_t now_ns, Severity severity, const char* code, std::string_view text,
                   double value, double threshold) noexcept {
  EventRecord event;
  event.mono_ns = now_ns;
  event.step = step;
  event.severity = severity;
  event.from = event.to = state_;
  copy_text(event.code, code);
  tell_who(event, text, by_);
  event.value = value;
  event.threshold = threshold;
  emit(event);
}

void Core::emit(const EventRecord& event) noexcept {
  fan_out(&Streams::events, event);
  host_events.push(event);
}

void Core::emit_step(std::int64_t now_ns, const protocol::Action& action) noexcept {
  if (action.step_ended) {
    // The next step has begun by now, maybe one of the next session: these belong to the one that is over.
    const auto& ended = plan_->steps[action.ended_step];
    if (action.settle_timed_out) {
      emit_of(action.ended_step, now_ns, Severity::kWarning, "settle.timeout",
              "force still moving when the settle step timed out", action.end_value, ended.force_slope_N_s);
    }
    if (ended.kind == protocol::StepKind::kWave) {
      char buffer[96];
      FixedText<96> text(buffer);
      text << "a wave of " << ended.frequency_hz << " Hz ran at " << action.end_value
           << " Hz, its turning points and way back included";
      emit_of(action.ended_step, now_ns, Severity::kInfo, "wave.done", buffer, action.end_value, ended.frequency_hz);
    }
    if (action.session_ended) {
      emit_of(action.ended_step, now_ns, Severity::kInfo, "session.end", plan_->sessions[ended.session].label,
              double(ended.session), 0.0);
    }
  }
  if (action.step_began) {
    const auto& step = plan_->steps[action.step];
    if (step.session != protocol::kNoSession && plan_->sessions[step.session].first_step == action.step) {
      emit(now_ns, Severity::kInfo, "session.start", plan_->sessions[step.session].label, double(step.session), 0.0);
    }
    if (step.kind == protocol::StepKind::kMark) {
      emit(now_ns, Severity::kInfo, "mark", step.label, double(action.step), 0.0);
    } else {
      emit(now_ns, Severity::kInfo, "step", protocol::name_of(step.kind), double(action.step), 0.0);
    }
  }
}

}  // namespace isorig::daemon
