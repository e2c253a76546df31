#include <algorithm>
#include <cmath>

#include "daemon/core/seconds.hpp"
#include "daemon/core/supervisor.hpp"

/// Supervisor: what the frame's samples and reports say.
namespace isorig::daemon {
namespace {

// Beyond a limit that has tripped already the crosshead comes to rest, and may go back; further than this it trips
// anew.
constexpr double kTravelMargin_mm = 0.2;
constexpr double kForceMarginShare = 0.05;  // of the range between the two limits

}  // namespace

void Supervisor::on_frame_sample(const FrameRecord& s) noexcept {
  frame_age_.on_sample(s.mono_ns, absence_);
  if (!std::isfinite(s.position_mm) || !std::isfinite(s.force_N)) {
    number_missing_ns_ = s.mono_ns;
    note("frame.number", "the frame sent a value that is not a number; check its transducers and the register map", 0.0,
         0.0);
    return;
  }
  last_position_mm_ = s.position_mm;
  last_raw_position_mm_ = double{s.raw_position_mm};
  last_force_N_ = s.force_N;
  watch_limit(travel_, "limit.travel", "position outside the travel limits; check the specimen and the zero",
              s.position_mm, travel_bounds());
  watch_limit(force_, "limit.force", "force outside its limits; check specimen, grips and load cell", s.force_N,
              force_bounds());
  watch_force(s);
  watch_following(s);
  watch_arrival(s);
}

Supervisor::Bounds Supervisor::travel_bounds() const noexcept {
  const auto& l = config_.limits;
  return {l.travel_min_mm, l.travel_max_mm, protocol::Limits::kTravelTolerance_mm, kTravelMargin_mm};
}

Supervisor::Bounds Supervisor::force_bounds() const noexcept {
  const auto& l = config_.limits;
  return {l.force_min_N, l.force_max_N, 0.0, kForceMarginShare * (l.force_max_N - l.force_min_N)};
}

bool Supervisor::Bounds::is_clear(double value, int beyond) const noexcept {
  // No more than a quarter of the way to zero: a limit near it could not be left.
  const double limit = beyond > 0 ? most : least;
  return beyond * (limit - value) > 0.25 * std::min(margin, std::abs(limit));
}

void Supervisor::watch_limit(Passed& passed, const char* code, const char* what, double value,
                             const Bounds& b) noexcept {
  const int beyond = value > b.most + b.tolerance ? 1 : value < b.least - b.tolerance ? -1 : 0;
  const bool known = beyond != 0 && beyond == passed.beyond && beyond * (value - passed.worst) <= b.margin;
  if (beyond == 0) {
    if (b.is_clear(value, passed.beyond)) passed = {};
  } else if (!known) {
    passed = {beyond, value};
    note(code, what, value, beyond > 0 ? b.most : b.least);
  }
}

void Supervisor::rearm_limit(Passed& passed, double value, const Bounds& b) noexcept {
  const int beyond = value > b.most ? 1 : value < b.least ? -1 : 0;
  if (beyond != 0) {
    passed = {beyond, value};
  } else if (b.is_clear(value, passed.beyond)) {
    passed = {};
  } else if (passed.beyond != 0) {
    passed.worst = passed.beyond > 0 ? b.most : b.least;
  }
}

std::optional<Supervisor::Binding> Supervisor::binding(double target_mm) const noexcept {
  const auto& l = config_.limits;
  const bool target_inside = target_mm >= l.travel_min_mm && target_mm <= l.travel_max_mm;
  if (travel_.beyond * (target_mm - last_position_mm_) > 0.0 && !target_inside) {
    return Binding{"the crosshead is beyond a travel limit: only a motion back is let through", "limit.travel",
                   last_position_mm_, travel_.beyond > 0 ? l.travel_max_mm : l.travel_min_mm};
  }
  // Tension falls when the specimen shortens.
  if (force_.beyond * (target_mm - last_position_mm_) > 0.0) {
    const double limit_N = force_.beyond > 0 ? l.force_max_N : l.force_min_N;
    const bool outside = force_.beyond * (last_force_N_ - limit_N) > 0.0;
    return Binding{outside ? "the force is beyond a limit: only a motion that takes it back is let through"
                           : "the force was beyond a limit and is only just inside: only a motion that takes it "
                             "further back is let through",
                   "limit.force", last_force_N_, limit_N};
  }
  return std::nullopt;
}

void Supervisor::watch_force(const FrameRecord& s) noexcept {
  const auto found = force_watch_.add(s.mono_ns, s.raw_force_N, s.force_N, segment_moving_);
  if (found.has_window) {
    if (found.rate_N_s > config_.limits.force_rate_max_N_s) {
      note("limit.force_rate", "force changes too fast; a slip, a burst or a loose grip", found.rate_N_s,
           config_.limits.force_rate_max_N_s);
    }
    // What fell while nobody looked may have fallen slowly: a Teensy that vents by itself is no broken specimen.
    // Samples that are no further apart than they may be are seen, on a slow line, too.
    const bool seen = found.window_s <= config_.frame_age_max_s;
    const double gone_N = std::abs(found.before_N) - std::abs(s.force_N);
    if (seen && config_.break_drop_N > 0.0 && gone_N > config_.break_drop_N &&
        gone_N > 0.5 * std::abs(found.before_N)) {
      note("specimen.broken", "the force collapsed: the specimen broke, burst or slipped out of its grips", s.force_N,
           found.before_N);
    }
  }
  if (found.frozen_s > 0.0) {
    note("force.frozen", "the force reading does not change, and its own noise should change it; check the load cell",
         found.frozen_s, config_.frozen_force_max_s);
  }
}

void Supervisor::watch_following(const FrameRecord& s) noexcept {
  if (!segment_active_ || !segment_acknowledged_) return;
  // Where the crosshead may be: between standing still for the permitted error and having run the whole segment.
  const double speed_mm_s = double{segment_.velocity_mm_s};
  const double elapsed_s = std::max(0.0, seconds(s.mono_ns - segment_start_ns_));
  const double length = double{segment_.target_mm} - segment_from_mm_;
  const double done = std::min(std::abs(length), speed_mm_s * elapsed_s);
  const double expected = segment_from_mm_ + std::copysign(done, length);
  const double error_mm = std::abs(double{s.raw_position_mm} - expected);
  // Scaled with the speed (as LinuxCNC's FERROR and MIN_FERROR), or a slow ramp is believed for minutes.
  const double allowed_mm =
      std::min(config_.following_error_max_mm + 0.05 * speed_mm_s, config_.following_error_min_mm + 0.25 * speed_mm_s);
  if (error_mm > allowed_mm) {
    note("frame.following", "the crosshead does not follow its segment; check drive and speed",
         double{s.raw_position_mm}, expected);
  } else if (error_mm > 0.5 * allowed_mm && !lag_warned_) {
    lag_warned_ = true;
    note("frame.lags", "the crosshead follows its segment late; at twice this error the program stops", error_mm,
         allowed_mm);
  }
}

/// "Reached" is the frame's word; where the crosshead is, the first sample from after it says, also of a stream that
/// has to be caught up with. By then the next segment may have begun: 50 ms of the speed are far more than that way.
void Supervisor::watch_arrival(const FrameRecord& s) noexcept {
  if (arrived_ns_ < 0 || s.mono_ns < arrived_ns_) return;
  arrived_ns_ = -1;
  const double speed_mm_s = std::max(double{arrived_.velocity_mm_s}, double{segment_.velocity_mm_s});
  if (std::abs(double{s.raw_position_mm} - double{arrived_.target_mm}) >
      config_.following_error_min_mm + 0.05 * speed_mm_s) {
    note("frame.following", "the frame says that it has reached its target, and is not there; check drive and zero",
         double{s.raw_position_mm}, double{arrived_.target_mm});
  }
}

void Supervisor::watch_frame_faults(const frame::State& state) noexcept {
  const auto bits = static_cast<double>(state.fault_bits);
  if ((state.fault_bits & frame::kInterlockOpen) != 0) {
    note("interlock.frame", "the frame says its safety chain is open; close it, then reset", bits, 0.0);
  } else if ((state.fault_bits & frame::kHeartbeatLost) != 0) {
    note("frame.heartbeat", "the frame missed our heartbeat and stopped by itself; reset", bits, 0.0);
  } else if ((state.fault_bits & ~frame::kSampleBufferOverrun) != 0) {
    note("frame.fault", "the frame reports a fault; read its own display, then reset", bits, 0.0);
  } else if (state.motion == frame::Motion::kFault) {
    note("frame.fault",
         "the frame is in a fault state, or in one that its map does not name; read its own display, then reset", 0.0,
         0.0);
  } else if (state.motion == frame::Motion::kDisabled && run_open_) {
    note("frame.fault", "the frame's drive is off: it does not hold its position; find out why, then reset", 0.0, 0.0);
  }
}

void Supervisor::on_frame_report(const FrameReport& report) noexcept {
  const frame::State& state = report.state;
  if (report.reference_epoch != reference_epoch_) {
    reference_epoch_ = report.reference_epoch;
    at_rest_ = false;  // it counts from another zero: that is no motion
  }
  watch_standstill(report);
  frame_state_ = state;
  frame_state_known_ = true;
  // A report counts for a segment only when the frame has taken that very segment: an old number that is echoed
  // still is another one's.
  const bool is_of_segment =
      segment_active_ && report.taken_segment == segment_number_ && state.segment_id == segment_.id;
  segment_moving_ = is_of_segment && state.motion == frame::Motion::kMoving;
  watch_frame_faults(state);
  if (is_of_segment && segment_acknowledged_ &&
      (state.motion == frame::Motion::kStopped || state.motion == frame::Motion::kLimit ||
       state.motion == frame::Motion::kDisabled)) {
    note(
        "frame.stopped",
        "the frame stopped short of its target, and not because we said so; look at its display, then reset and resume",
        0.0, double{segment_.target_mm});
    segment_active_ = segment_moving_ = false;
  }
  // A connection that is started afresh stops the frame. A segment that has arrived loses nothing; one that waits to be
  // taken, as the next chord of a wave, would go on from where the stop happened to end.
  reconnects_ = report.reconnects;
  if (segment_active_ && !segment_arrived_ && reconnects_ != segment_reconnects_) {
    note("frame.stopped",
         "the connection to the frame was lost and started afresh, which stopped it short of its target; check the "
         "line, then reset and resume",
         last_raw_position_mm_, double{segment_.target_mm});
    segment_active_ = segment_moving_ = false;
  }
  if (is_of_segment && segment_acknowledged_ && !segment_arrived_ && state.motion == frame::Motion::kReached) {
    segment_arrived_ = true;
    arrived_ns_ = report.mono_ns;
    arrived_ = segment_;
  }
  if (segment_active_ && !segment_acknowledged_ && report.refused_segment == segment_number_) {
    note("frame.segment", "the frame refused the segment; look at its display and its limits", 0.0,
         double{segment_.target_mm});
    segment_active_ = segment_moving_ = false;
  }
  if (is_of_segment && segment_active_ && !segment_acknowledged_) {
    segment_acknowledged_ = true;
    if (std::abs(state.target_mm - segment_.target_mm) > 1e-3F ||
        std::abs(state.velocity_mm_s - segment_.velocity_mm_s) > 1e-3F * segment_.velocity_mm_s) {
      note("frame.segment", "the frame echoes another target or velocity than was sent", double{state.target_mm},
           double{segment_.target_mm});
    }
  }
}

void Supervisor::on_segment(const frame::Segment& segment, std::uint32_t number, double from_mm,
                            std::int64_t mono_ns) noexcept {
  segment_number_ = number;
  segment_reconnects_ = reconnects_;
  segment_active_ = told_to_move_ = true;
  segment_acknowledged_ = segment_arrived_ = lag_warned_ = false;
  segment_ = segment;
  segment_from_mm_ = from_mm;
  segment_start_ns_ = mono_ns;
}

void Supervisor::on_stop(std::int64_t mono_ns, std::uint32_t request) noexcept {
  segment_active_ = segment_moving_ = false;
  arrived_ns_ = -1;
  if (!stop_pending_) {
    stop_renewed_ = !told_to_move_ && frame_stands_;
    if (!stop_renewed_) at_rest_ = false;
  } else if (told_to_move_) {
    stop_renewed_ = at_rest_ = false;
  }
  // A request that comes while another waits makes it neither younger nor another, unless a motion was commanded
  // between.
  if (!stop_pending_) stop_since_ns_ = mono_ns;
  if (!stop_pending_ || told_to_move_) stop_request_ = request;
  stop_pending_ = true;
  told_to_move_ = false;
}

void Supervisor::watch_standstill(const FrameReport& report) noexcept {
  frame_stands_ = report.stands && report.stop_confirmed;
  // Counted round.
  const bool is_ours = static_cast<std::int32_t>(report.stop_request - stop_request_) >= 0;
  if (stop_pending_ && report.stop_confirmed && is_ours) {
    stop_pending_ = stop_renewed_ = false;
    at_rest_ = true;
    rest_mm_ = double{report.position_mm};
    // A segment that waited for the stop begins here.
    if (segment_active_ && !segment_acknowledged_) {
      segment_from_mm_ = rest_mm_;
      segment_start_ns_ = report.mono_ns;
    }
  }
  if (!at_rest_ || segment_active_ || !report.stop_confirmed) return;
  const bool must_rest = state_ == RunState::kPaused || state_ == RunState::kStopping ||
                         state_ == RunState::kCountdown || state_ == RunState::kSetup ||
                         ((state_ == RunState::kFaulted || state_ == RunState::kArmed) && run_open_);
  if (!must_rest) {
    rest_mm_ = double{report.position_mm};  // an operator may move it at its own panel
  } else if (const double moved_mm = std::abs(double{report.position_mm} - rest_mm_);
             moved_mm > config_.standstill_max_mm) {
    note("frame.stop", "the crosshead moves although it was stopped; stop it at its own panel or emergency stop",
         moved_mm, config_.standstill_max_mm);
  }
}

}  // namespace isorig::daemon
