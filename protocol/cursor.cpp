#include "protocol/cursor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "protocol/wave.hpp"

namespace isorig::protocol {
namespace {

std::int64_t to_ns(double seconds) noexcept {
  return static_cast<std::int64_t>(std::llround(seconds * 1e9));
}
double to_s(std::int64_t ns) noexcept {
  return static_cast<double>(ns) * 1e-9;
}

}  // namespace

const char* describe(Failure failure) noexcept {
  switch (failure) {
    case Failure::kNone:
      return "no failure";
    case Failure::kPressurizeTimeout:
      return "the pressure did not settle at its set-point in time";
    case Failure::kSettleTimeout:
      return "the force did not settle in time";
    case Failure::kMotionTimeout:
      return "the frame did not reach its target in time";
  }
  return "unknown failure";
}

void Cursor::start(std::int64_t now_ns, std::uint32_t first_session, std::uint16_t next_segment_id) noexcept {
  action_ = Action{};
  next_id_ = next_segment_id;
  has_flags_ = false;
  reissue_pending_ = false;
  full_until_ns_ = std::numeric_limits<std::int64_t>::min();
  step_begin_ns_ = now_ns;
  quiet_until_ns_ = 0;
  pressurize_ = kNoStep;
  if (first_session >= plan_->sessions.size()) {
    action_.state = CursorState::kFinished;
    action_.step = static_cast<std::uint32_t>(plan_->steps.size() - 1);
    return;
  }
  action_.state = CursorState::kRunning;
  action_.step = first_session == 0 ? 0 : plan_->sessions[first_session].first_step;
  begin_pending_ = true;
}

const Action& Cursor::advance(std::int64_t now_ns, const Observation& seen) noexcept {
  if (now_ns < quiet_until_ns_ && !has_flags_) return action_;
  if (has_flags_) {
    action_.start_segment = action_.step_began = action_.step_ended = false;
    action_.settle_timed_out = action_.session_ended = false;
    has_flags_ = false;
    if (now_ns < quiet_until_ns_) return action_;
  }
  if (action_.state != CursorState::kRunning) {
    decide_keep(now_ns);
    return action_;
  }
  if (begin_pending_) {
    begin_pending_ = false;
    const Step& first = plan_->steps[action_.step];
    if (plan_->approaches && std::abs(seen.position_mm - first.position_before_mm) > kAtPosition_mm) {
      action_.approaching = true;
      begin_motion(now_ns, seen, first.position_before_mm, plan_->approach_velocity_mm_s);
    } else {
      begin_step(now_ns, seen, action_.step);
    }
  } else if (action_.approaching) {
    tick_approach(now_ns, seen);
  } else if (!action_.regaining || has_regained(now_ns, seen)) {
    switch (plan_->steps[action_.step].kind) {
      case StepKind::kPressurize:
        tick_pressurize(now_ns, seen);
        break;
      case StepKind::kSettle:
        tick_settle(now_ns, seen);
        break;
      case StepKind::kRamp:
        tick_ramp(now_ns, seen);
        break;
      case StepKind::kWave:
        tick_wave(now_ns, seen);
        break;
      case StepKind::kHold:
        if (now_ns >= step_end_ns_) end_step(now_ns, seen);
        break;
      case StepKind::kMark:
        end_step(now_ns, seen);
        break;
    }
  }
  decide_keep(now_ns);
  return action_;
}

void Cursor::begin_step(std::int64_t now_ns, const Observation& seen, std::uint32_t index) noexcept {
  const Step& step = plan_->steps[index];
  action_.step = index;
  action_.step_began = has_flags_ = true;
  step_begin_ns_ = now_ns;
  good_since_ns_ = kNever;
  next_chord_ns_ = kNever;
  switch (step.kind) {
    case StepKind::kPressurize:
      pressurize_ = index;
      action_.setpoint_psi = step.pressure_psi;
      action_.rate_psi_s = step.rate_psi_s;
      deadline_ns_ = now_ns + to_ns(step.timeout_s);
      break;
    case StepKind::kSettle:
      slope_.reset(now_ns, step.window_s);
      deadline_ns_ = now_ns + to_ns(step.timeout_s);
      break;
    case StepKind::kRamp:
      begin_motion(now_ns, seen, step.target_mm, step.velocity_mm_s);
      break;
    case StepKind::kHold:
      step_end_ns_ = now_ns + to_ns(step.duration_s);
      break;
    case StepKind::kWave:
      stroke_ = 0;
      begin_stroke(now_ns);
      break;
    case StepKind::kMark:
      break;
  }
}

void Cursor::end_step(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& step = plan_->steps[action_.step];
  action_.step_ended = has_flags_ = true;
  action_.ended_step = action_.step;
  if (step.kind == StepKind::kWave) {
    action_.end_value = step.cycles / to_s(std::max<std::int64_t>(now_ns - step_begin_ns_, 1));
  } else if (step.kind != StepKind::kSettle) {
    action_.end_value = 0.0;
  }
  if (step.full_after_s > 0.0) full_until_ns_ = now_ns + to_ns(step.full_after_s);
  const bool last = action_.step + 1 == plan_->steps.size();
  action_.session_ended =
      step.session != kNoSession && (last || plan_->steps[action_.step + 1].session != step.session);
  if (last) {
    action_.state = CursorState::kFinished;
  } else {
    begin_step(now_ns, seen, action_.step + 1);
  }
}

void Cursor::fail(Failure failure, double value, double threshold) noexcept {
  action_.state = CursorState::kFailed;
  action_.failure = failure;
  action_.failure_value = value;
  action_.failure_threshold = threshold;
}

void Cursor::send_segment(double target_mm, double velocity_mm_s) noexcept {
  if (next_id_ == 0) next_id_ = 1;
  action_.segment = {next_id_++, target_mm, velocity_mm_s};
  action_.start_segment = has_flags_ = true;
}

void Cursor::begin_motion(std::int64_t now_ns, const Observation& seen, double target_mm,
                          double velocity_mm_s) noexcept {
  const double nominal_s = std::abs(target_mm - seen.position_mm) / velocity_mm_s;
  deadline_ns_ = now_ns + to_ns(nominal_s * (1.0 + kMotionSlackShare) + kMotionSlack_s);
  send_segment(target_mm, velocity_mm_s);
}

void Cursor::begin_stroke(std::int64_t now_ns) noexcept {
  const Step& step = plan_->steps[action_.step];
  const double nominal_s = wave::stroke_s(step, stroke_);
  stroke_begin_ns_ = now_ns;
  chord_ = 0;
  const std::uint32_t chords = wave::chords(step, stroke_);
  next_chord_ns_ = chords > 1 ? now_ns + to_ns(nominal_s / chords) : kNever;
  deadline_ns_ = now_ns + to_ns(nominal_s * (1.0 + kMotionSlackShare) + kMotionSlack_s);
  send_segment(wave::target_mm(step, stroke_), wave::chord_speed_mm_s(step, stroke_, 0));
}

void Cursor::tick_approach(std::int64_t now_ns, const Observation& seen) noexcept {
  const double target_mm = plan_->steps[action_.step].position_before_mm;
  if (reissue_pending_) {
    reissue_pending_ = false;
    begin_motion(now_ns, seen, target_mm, plan_->approach_velocity_mm_s);
  } else if (reached(seen)) {
    action_.approaching = false;
    begin_step(now_ns, seen, action_.step);
  } else if (now_ns >= deadline_ns_) {
    fail(Failure::kMotionTimeout, seen.position_mm, target_mm);
  }
}

void Cursor::tick_pressurize(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& step = plan_->steps[action_.step];
  if (std::abs(seen.pressure_psi - step.pressure_psi) > step.tolerance_psi) {
    good_since_ns_ = kNever;
  } else if (good_since_ns_ == kNever) {
    good_since_ns_ = now_ns;
  }
  if (good_since_ns_ != kNever && now_ns - good_since_ns_ >= to_ns(step.settled_for_s)) {
    end_step(now_ns, seen);
  } else if (now_ns >= deadline_ns_) {
    fail(Failure::kPressurizeTimeout, seen.pressure_psi, step.pressure_psi);
  }
}

void Cursor::tick_settle(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& step = plan_->steps[action_.step];
  if (seen.new_force && slope_.add(now_ns, seen.force_N)) {
    if (!slope_.full() || std::abs(slope_.slope_N_s()) > step.force_slope_N_s) {
      good_since_ns_ = kNever;
    } else if (good_since_ns_ == kNever) {
      good_since_ns_ = now_ns;
    }
  }
  const bool settled =
      slope_.full() && good_since_ns_ != kNever && now_ns - good_since_ns_ >= to_ns(step.settled_for_s);
  if (!settled && now_ns < deadline_ns_) return;
  const double slope_N_s = slope_.full() ? std::abs(slope_.slope_N_s()) : std::numeric_limits<double>::infinity();
  if (!settled && step.on_timeout == OnTimeout::kStop) {
    fail(Failure::kSettleTimeout, slope_N_s, step.force_slope_N_s);
    return;
  }
  action_.end_value = slope_N_s;
  action_.settle_timed_out = !settled;
  end_step(now_ns, seen);
}

void Cursor::tick_ramp(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& step = plan_->steps[action_.step];
  if (reissue_pending_) {
    reissue_pending_ = false;
    begin_motion(now_ns, seen, step.target_mm, step.velocity_mm_s);
  } else if (reached(seen)) {
    end_step(now_ns, seen);
  } else if (now_ns >= deadline_ns_) {
    fail(Failure::kMotionTimeout, seen.position_mm, step.target_mm);
  }
}

void Cursor::tick_wave(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& step = plan_->steps[action_.step];
  if (reissue_pending_) {
    reissue_pending_ = false;
    // The way may be longer than it was: the crosshead that was stopped beyond its target has to come back.
    const auto deadline_ns = deadline_ns_;
    begin_motion(now_ns, seen, wave::target_mm(step, stroke_), wave::chord_speed_mm_s(step, stroke_, chord_));
    deadline_ns_ = std::max(deadline_ns_, deadline_ns);
  } else if (reached(seen)) {
    if (++stroke_ == wave::strokes(step)) {
      end_step(now_ns, seen);
    } else {
      begin_stroke(now_ns);
    }
  } else if (now_ns >= next_chord_ns_) {
    const std::uint32_t chords = wave::chords(step, stroke_);
    const double chord_s = wave::stroke_s(step, stroke_) / chords;
    ++chord_;
    next_chord_ns_ = chord_ + 1 < chords ? stroke_begin_ns_ + to_ns(chord_s * (chord_ + 1)) : kNever;
    send_segment(wave::target_mm(step, stroke_), wave::chord_speed_mm_s(step, stroke_, chord_));
  } else if (now_ns >= deadline_ns_) {
    fail(Failure::kMotionTimeout, seen.position_mm, wave::target_mm(step, stroke_));
  }
}

void Cursor::decide_keep(std::int64_t now_ns) noexcept {
  const Step& step = plan_->steps[action_.step];
  const bool at_work = action_.state == CursorState::kRunning && !action_.approaching && !begin_pending_;
  const bool in_tail = now_ns < full_until_ns_;
  const bool full = in_tail || plan_->recording.mode == RecordingMode::kFull || (at_work && step.keep == Keep::kFull);
  quiet_until_ns_ = 0;
  if (at_work && step.kind == StepKind::kHold && !action_.regaining) {
    quiet_until_ns_ = in_tail ? std::min(step_end_ns_, full_until_ns_) : step_end_ns_;
  }
  action_.keep = full ? Keep::kFull : Keep::kAveraged;
}

void Cursor::pause(std::int64_t now_ns) noexcept {
  if (action_.state != CursorState::kRunning) return;
  action_.state = CursorState::kPaused;
  if (!std::exchange(action_.regaining, false)) pause_ns_ = now_ns;  // else it has not gone on since the last pause
  quiet_until_ns_ = 0;
  const Step& step = plan_->steps[action_.step];
  if (step.keep == Keep::kFull && step.full_after_s > 0.0) full_until_ns_ = now_ns + to_ns(step.full_after_s);
}

void Cursor::resume(std::int64_t now_ns) noexcept {
  if (action_.state != CursorState::kPaused) return;
  action_.state = CursorState::kRunning;
  const StepKind kind = plan_->steps[action_.step].kind;
  const bool under_pressure = pressurize_ != kNoStep && !action_.approaching && !begin_pending_;
  if (under_pressure && kind != StepKind::kPressurize) {
    action_.regaining = true;
    regain_deadline_ns_ = now_ns + to_ns(plan_->steps[pressurize_].timeout_s);
    good_since_ns_ = kNever;
    has_strayed_ = false;
  } else {
    go_on(now_ns);
  }
}

/// The pressure may have leaked, and sealed valves do not make up for it. A motion or a hold at another pressure than
/// the step's would be recorded as the step's.
bool Cursor::has_regained(std::int64_t now_ns, const Observation& seen) noexcept {
  const Step& last = plan_->steps[pressurize_];
  if (std::abs(seen.pressure_psi - last.pressure_psi) > last.tolerance_psi) {
    has_strayed_ = true;
    good_since_ns_ = kNever;
  } else if (good_since_ns_ == kNever) {
    good_since_ns_ = now_ns;
  }
  if (good_since_ns_ != kNever && (!has_strayed_ || now_ns - good_since_ns_ >= to_ns(last.settled_for_s))) {
    action_.regaining = false;
    go_on(now_ns);
    return true;
  }
  if (now_ns >= regain_deadline_ns_) {
    action_.regaining = false;
    fail(Failure::kPressurizeTimeout, seen.pressure_psi, last.pressure_psi);
  }
  return false;
}

void Cursor::go_on(std::int64_t now_ns) noexcept {
  const std::int64_t away_ns = now_ns - pause_ns_;
  step_begin_ns_ += away_ns;
  step_end_ns_ += away_ns;
  deadline_ns_ += away_ns;
  stroke_begin_ns_ += away_ns;
  if (next_chord_ns_ != kNever) next_chord_ns_ += away_ns;
  good_since_ns_ = kNever;
  slope_.restart(now_ns);
  const StepKind kind = plan_->steps[action_.step].kind;
  reissue_pending_ = !begin_pending_ && (action_.approaching || kind == StepKind::kRamp || kind == StepKind::kWave);
}

Progress Cursor::progress(std::int64_t now_ns) const noexcept {
  const Step& step = plan_->steps[action_.step];
  Progress out;
  out.step_nominal_s = step.nominal_s;
  if (action_.state == CursorState::kFinished) {
    out.fraction = 1.0;
    return out;
  }
  if (!action_.approaching && !begin_pending_ && action_.state != CursorState::kIdle) {
    out.step_elapsed_s =
        to_s((action_.state == CursorState::kPaused || action_.regaining ? pause_ns_ : now_ns) - step_begin_ns_);
  }
  const double done_s = step.start_s + std::min(out.step_elapsed_s, step.nominal_s);
  out.fraction = plan_->nominal_s > 0.0 ? std::min(1.0, done_s / plan_->nominal_s) : 0.0;
  out.remaining_s = std::max(0.0, plan_->nominal_s - done_s);
  if (action_.approaching) {
    // No step of the plan: its time is that of its deadline, without the slack. Too long by 5 % of what has passed.
    const std::int64_t at_ns = action_.state == CursorState::kPaused ? pause_ns_ : now_ns;
    out.remaining_s += std::max(0.0, (to_s(deadline_ns_ - at_ns) - kMotionSlack_s) / (1.0 + kMotionSlackShare));
  }
  return out;
}

}  // namespace isorig::protocol
