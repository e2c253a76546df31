#include <algorithm>
#include <cmath>

#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: what lies between an operator's command and a motion: two acts and a countdown before a run, and setup, in
/// which the crosshead is jogged (docs/states.md).
namespace isorig::daemon {
namespace {

constexpr double kJogForceMarginShare = 0.02;  // of the force range: beyond the jog's limit it may still be moved back
constexpr double kJogLeast_mm = 0.001;

std::int64_t after(std::int64_t now_ns, double seconds) noexcept {
  return now_ns + static_cast<std::int64_t>(seconds * 1e9);
}

}  // namespace

double Core::operator_left_s(std::int64_t now_ns) const noexcept {
  const bool counts = state_ == RunState::kArmed || state_ == RunState::kCountdown || state_ == RunState::kSetup;
  return counts ? std::max(0.0, static_cast<double>(operator_until_ns_ - now_ns) * 1e-9) : -1.0;
}

void Core::arm(std::int64_t now_ns) noexcept {
  operator_until_ns_ = after(now_ns, config_.operating.arm_window_s);
  transition(now_ns, RunState::kArmed, Severity::kInfo, "armed",
             run_open_ ? "armed to go on: isorig go begins the countdown, isorig pause takes it back"
                       : "armed: isorig go begins the countdown, isorig pause takes it back",
             config_.operating.arm_window_s, 0.0);
}

const char* Core::count_down(std::int64_t now_ns, const Request& request) noexcept {
  if (state_ != RunState::kArmed) return "a start has to be armed first (isorig start)";
  if (!run_open_) {
    if (request.plan == nullptr) return "no protocol was given";
    if (const char* missing = why_not_ready(now_ns)) return missing;
    open_run(now_ns, request);
  }
  operator_until_ns_ = after(now_ns, config_.operating.countdown_s);
  said_left_s_ = static_cast<int>(std::ceil(config_.operating.countdown_s)) + 1;
  transition(now_ns, RunState::kCountdown, Severity::kInfo, "countdown.begin",
             "keep clear: the rig moves and fills when the countdown is over; isorig pause or abort ends it",
             config_.operating.countdown_s, 0.0);
  return nullptr;
}

void Core::stand_down(std::int64_t now_ns, Severity severity, const char* code, const char* why) noexcept {
  if (run_open_ && run_begun_) {
    transition(now_ns, RunState::kPaused, severity, code, why, 0.0, 0.0);
  } else if (run_open_) {
    emit(now_ns, severity, code, why, 0.0, 0.0);
    end_run(now_ns, Outcome::kNotStarted, "the countdown was not completed: nothing has moved");
  } else {
    transition(now_ns, RunState::kIdle, severity, code, why, 0.0, 0.0);
  }
}

void Core::watch_operator(std::int64_t now_ns, const char* not_ready) noexcept {
  const bool over = now_ns >= operator_until_ns_;
  const bool fresh = !(run_open_ && run_begun_);  // nothing has moved or filled for this run yet
  switch (state_) {
    case RunState::kArmed:
      if (fresh && not_ready != nullptr) {
        stand_down(now_ns, Severity::kWarning, "disarmed", not_ready);
      } else if (over) {
        stand_down(now_ns, Severity::kInfo, "disarmed", "nobody gave the second act (isorig go) in time");
      }
      break;
    case RunState::kCountdown:
      if (fresh && not_ready != nullptr) {
        stand_down(now_ns, Severity::kWarning, "countdown.end", not_ready);
      } else if (over) {
        if (supervisor_.stands()) {
          set_off(now_ns);
        } else {
          stand_down(now_ns, Severity::kWarning, "countdown.end", "the crosshead is not seen to stand");
        }
      } else if (const int left_s = static_cast<int>(std::ceil(operator_left_s(now_ns))); left_s < said_left_s_) {
        said_left_s_ = left_s;
        char text[40];
        FixedText words(text);
        words << "the rig moves in " << static_cast<std::int64_t>(left_s) << " s";
        emit(now_ns, Severity::kInfo, "countdown", text, double(left_s), 0.0);
      }
      break;
    case RunState::kSetup:
      watch_setup(now_ns);
      break;
    default:
      break;
  }
}

const char* Core::why_no_setup(std::int64_t now_ns) const noexcept {
  const char* why = nullptr;
  if (!supervisor_.healthy(now_ns, &why, config_.operating.jog_with_guard_open)) return why;
  if (zero_epoch_ != confirmed_zero_)
    return "the frame's zero is not confirmed since it was started (isorig confirm-zero)";
  if (pressure_psi_ >= config_.vented_psi) return "the actuator is under pressure (isorig abort vents)";
  return nullptr;
}

void Core::enter_setup(std::int64_t now_ns, const char* text) noexcept {
  cursor_.reset();
  plan_ = nullptr;
  step_ = kNoStep;
  jogging_ = false;
  setup_wanted_ = false;
  clear_faults();  // of a run before
  operator_until_ns_ = after(now_ns, config_.operating.setup_max_s);
  supervisor_.rearm(now_ns);
  guard_.restart();       // a doubt from between the runs, where it trips nothing, may be hours old
  stop_and_vent(now_ns);  // stands and is vented already: from here on it is watched that it stays so
  transition(now_ns, RunState::kSetup, Severity::kInfo, "setup", text, seen_.position_mm, 0.0);
}

void Core::leave_setup(std::int64_t now_ns, Severity severity, const char* code, const char* why) noexcept {
  jogging_ = false;
  stop_and_vent(now_ns);
  transition(now_ns, RunState::kStopping, severity, code, why, seen_.position_mm, 0.0);
}

const char* Core::jog(std::int64_t now_ns, const Request& request) noexcept {
  const auto& o = config_.operating;
  const auto& l = config_.supervisor.limits;
  if (state_ != RunState::kSetup) return "the crosshead is jogged in setup only (isorig setup)";
  if (jogging_) return "a jog is under way; it ends by itself, or with isorig pause";
  if (const char* why = why_no_setup(now_ns)) return why;
  const double position_mm = seen_.position_mm;
  const double target_mm = request.relative ? position_mm + request.target_mm : request.target_mm;
  const double most_mm_s = o.jog_speed_max_mm_s * (now_.guard_closed ? 1.0 : 0.5);
  const double velocity_mm_s = request.velocity_mm_s == 0.0 ? most_mm_s : request.velocity_mm_s;
  const double way_mm = target_mm - position_mm;
  if (!std::isfinite(target_mm) || !std::isfinite(velocity_mm_s)) return "target and velocity have to be numbers";
  if (velocity_mm_s > most_mm_s) {
    FixedText words(jog_refusal_);
    words << velocity_mm_s << " mm/s is faster than "
          << (now_.guard_closed ? "[operator] jog_speed_max_mm_s, " : "the guard is open for, half of the jog's most: ")
          << most_mm_s << " mm/s";
    return jog_refusal_;
  }
  if (velocity_mm_s < l.speed_min_mm_s || velocity_mm_s <= 0.0) return "that is slower than [limits] speed_min_mm_s";
  if (std::abs(way_mm) < kJogLeast_mm) return "the crosshead is there already";
  if (const auto kept = supervisor_.binding(target_mm)) return kept->why;
  if ((target_mm > l.travel_max_mm && way_mm > 0.0) || (target_mm < l.travel_min_mm && way_mm < 0.0)) {
    return "the target lies outside the travel limits";
  }
  const double room_mm = protocol::Limits::travel_room_mm(velocity_mm_s);
  if ((target_mm > l.travel_max_mm - room_mm && way_mm > 0.0) ||
      (target_mm < l.travel_min_mm + room_mm && way_mm < 0.0)) {
    FixedText words(jog_refusal_);
    words << "the target is too close to a travel limit for " << velocity_mm_s << " mm/s, which runs over it: stay "
          << room_mm << " mm inside, or jog slower";
    return jog_refusal_;
  }
  // Tension rises when the specimen gets longer.
  const double force_N = seen_.force_N;
  if (force_N > o.jog_force_max_N && way_mm > 0.0) {
    return "the tension is above [operator] jog_force_max_N: only a motion that takes it back is let through";
  }
  if (force_N < -o.jog_force_max_N && way_mm < 0.0) {
    return "the compression is above [operator] jog_force_max_N: only a motion that takes it back is let through";
  }
  const double margin_N = kJogForceMarginShare * (l.force_max_N - l.force_min_N);
  jog_force_high_N_ = force_N > o.jog_force_max_N ? force_N + margin_N : o.jog_force_max_N;
  jog_force_low_N_ = force_N < -o.jog_force_max_N ? force_N - margin_N : -o.jog_force_max_N;
  jog_velocity_mm_s_ = velocity_mm_s;
  if (!move_to(now_ns, static_cast<std::uint16_t>(frame_segment_id_ + 1), target_mm, velocity_mm_s))
    return "a limit is passed";
  seen_.segment_reached = false;  // of the segment before
  jogging_ = true;
  jog_until_ns_ = after(now_ns, o.jog_time_max_s);
  operator_until_ns_ = after(now_ns, o.setup_max_s);
  emit(now_ns, Severity::kInfo, "jog", "the crosshead is jogged; the threshold is its target", position_mm, target_mm);
  return nullptr;
}

void Core::end_jog(std::int64_t now_ns, Severity severity, const char* code, const char* why, double value,
                   double threshold) noexcept {
  jogging_ = false;
  request_stop(now_ns);
  operator_until_ns_ = after(now_ns, config_.operating.setup_max_s);
  emit(now_ns, severity, code, why, value, threshold);
}

void Core::watch_setup(std::int64_t now_ns) noexcept {
  if (pressure_psi_ >= config_.vented_psi) {
    leave_setup(now_ns, Severity::kWarning, "setup.pressure",
                "there is pressure in the actuator: setup is left, and it is vented");
    return;
  }
  if (now_ns >= operator_until_ns_) {
    leave_setup(now_ns, Severity::kInfo, "setup.expired", "nothing was done in setup for long: it is left");
    return;
  }
  if (!jogging_) return;
  const double most_mm_s = config_.operating.jog_speed_max_mm_s * 0.5;
  if (seen_.new_force && (seen_.force_N > jog_force_high_N_ || seen_.force_N < jog_force_low_N_)) {
    end_jog(now_ns, Severity::kWarning, "jog.force", "the jog ended at its force limit; check specimen and grips",
            seen_.force_N, seen_.force_N > 0.0 ? jog_force_high_N_ : jog_force_low_N_);
  } else if (!now_.guard_closed && jog_velocity_mm_s_ > most_mm_s) {
    end_jog(now_ns, Severity::kWarning, "jog.guard", "the guard was opened in a jog that is too fast for that",
            jog_velocity_mm_s_, most_mm_s);
  } else if (seen_.segment_reached) {
    end_jog(now_ns, Severity::kInfo, "jog.done", "the jog has reached its target", seen_.position_mm, 0.0);
  } else if (now_ns >= jog_until_ns_) {
    end_jog(now_ns, Severity::kInfo, "jog.time", "the jog ended after its longest time; jog again to go on",
            seen_.position_mm, 0.0);
  }
}

}  // namespace isorig::daemon
