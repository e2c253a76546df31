#include "daemon/core.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "daemon/fixed_text.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kEvidenceNs = 2'000'000'000;

}  // namespace

Core::Core(const CoreConfig& config, FrameLink& frame, PressureLink& pressure, InterlockLink& interlock,
           Streams& recorder, Streams* publisher) noexcept
    : config_(config),
      frame_(frame),
      pressure_(pressure),
      interlock_(interlock),
      recorder_(recorder),
      publisher_(publisher),
      supervisor_(config.supervisor),
      loop_(config.pressure_loop) {
  loop_.vent();
}

void Core::tick(std::int64_t now_ns, std::int64_t late_ns, std::int64_t last_run_ns) noexcept {
  ++ticks_;
  worst_wakeup_ns_ = std::max(worst_wakeup_ns_, late_ns);
  ++now_.lateness[lateness_bin(late_ns)];
  worst_run_ns_ = std::max(worst_run_ns_, last_run_ns);
  supervisor_.on_tick_lateness(now_ns, late_ns);

  read_interlock();
  read_frame();
  read_pressure();
  take_requests(now_ns);
  supervise(now_ns);
  step_plan(now_ns);
  command(now_ns);
  hand_off(now_ns);
}

void Core::read_frame() noexcept {
  Stamped<frame::Sample> in;
  force_new_ = 0;
  force_sum_N_ = 0.0;
  const auto& cal = config_.calibration;
  while (frame_.samples.pop(in)) {
    FrameRecord r;
    r.mono_ns = in.mono_ns;
    r.device_us = in.sample.device_us;
    r.sequence = in.sample.sequence;
    r.step = step_now();
    r.bound_ns = in.bound_ns;
    r.repeatability_ns = in.repeatability_ns;
    r.raw_position_mm = in.sample.position_mm;
    r.raw_force_N = in.sample.force_N;
    r.position_mm = double{in.sample.position_mm} * cal.position_scale + cal.position_offset_mm;
    r.force_N = double{in.sample.force_N} * cal.force_scale + cal.force_offset_N;
    r.keep = keep_;
    supervisor_.on_frame_sample(r);
    fan_out(&Streams::frame, r);
    if (observer_ != nullptr) observer_->frame.push(r);
    seen_.position_mm = r.position_mm;
    raw_position_mm_ = double{r.raw_position_mm};
    force_sum_N_ += r.force_N;
    ++force_new_;
  }
  seen_.new_force = force_new_ > 0;
  if (seen_.new_force) seen_.force_N = force_sum_N_ / force_new_;

  FrameReport report;
  while (frame_.reports.pop(report)) {
    supervisor_.on_frame_report(report.state);
    seen_.segment_reached = report.state.motion == frame::Motion::kReached;
    seen_.segment_id = report.state.segment_id;
    moving_ = report.state.motion == frame::Motion::kMoving;
  }
  clock::Exchange exchange;
  while (frame_.exchanges.pop(exchange)) {
    fan_out(&Streams::exchanges, ExchangeRecord{DeviceId::kFrame, exchange});
  }
  LinkHealth health;
  while (frame_.health.pop(health)) frame_health_ = health;
}

void Core::read_pressure() noexcept {
  Stamped<pressure::Sample> in;
  const auto& cal = config_.calibration;
  while (pressure_.samples.pop(in)) {
    const auto reading = monitor_.update(in.sample.raw_word, in.sample.device_us);
    PressureRecord r;
    r.mono_ns = in.mono_ns;
    r.device_us = in.sample.device_us;
    r.sequence = in.sample.sequence;
    r.step = step_now();
    r.bound_ns = in.bound_ns;
    r.repeatability_ns = in.repeatability_ns;
    r.raw_word = in.sample.raw_word;
    r.status = static_cast<std::uint8_t>(reading.word.status);
    r.keep = keep_;
    r.temperature_C = static_cast<float>(reading.temperature_c);
    r.pressure_psi = reading.pressure_psi * cal.pressure_scale + cal.pressure_offset_psi;
    fan_out(&Streams::pressure, r);
    if (observer_ != nullptr) observer_->pressure.push(r);
    // A stale word is the last value once more: neither news for the loop nor a fault.
    if (!reading.fresh || !reading.plausible()) {
      if (!reading.plausible()) ++now_.invalid_pressure;
      if ((reading.issues & messages::kElvhStuck) != 0) supervisor_.on_pressure_stuck();
      supervisor_.on_pressure_sample(r.mono_ns, r.pressure_psi, false);
      continue;
    }
    supervisor_.on_pressure_sample(r.mono_ns, r.pressure_psi, true);
    pressure_psi_ = r.pressure_psi;
    const double dt_s = std::clamp(static_cast<double>(r.mono_ns - filter_last_ns_) * 1e-9, 0.0, 1.0);
    filter_last_ns_ = r.mono_ns;
    seen_.pressure_psi += (r.pressure_psi - seen_.pressure_psi) * std::min(1.0, dt_s / config_.pressure_filter_s);
    loop_.update(r.mono_ns, r.pressure_psi, moving_ ? commanded_velocity_mm_s_ : 0.0);
  }
  clock::Exchange exchange;
  while (pressure_.exchanges.pop(exchange)) {
    fan_out(&Streams::exchanges, ExchangeRecord{DeviceId::kPressure, exchange});
  }
  SyncReport sync;
  while (pressure_.sync.pop(sync)) take_sync(sync);
  pressure::State state;
  while (pressure_.states.pop(state)) {
    if (state.vented_by_watchdog && state_ == RunState::kRunning) supervisor_.on_device_vented();
  }
  LinkHealth health;
  while (pressure_.health.pop(health)) pressure_health_ = health;
  while (pressure_.regulator_health.pop(health)) now_.regulator = health;
  RegulatorReport report;
  while (pressure_.regulator_reports.pop(report)) {
    supervisor_.on_regulator(report.mono_ns, double{report.state.pressure_psi}, pressure_psi_, report.state.faulty);
  }
}

void Core::take_sync(const SyncReport& report) noexcept {
  now_.sync = report.counts;
  if (!report.has_check) return;
  const bool was_within = now_.sync_check.mono_ns == 0 || now_.sync_check.within;
  now_.sync_check = report.check;
  fan_out(&Streams::sync, SyncRecord{report.mono_ns, report.check, report.counts});
  if (was_within && !report.check.within) {
    emit(report.mono_ns, Severity::kWarning, "clock.bound",
         "the sync line shows the Teensy's time further off than its bound; compare the two clocks (docs/clock.md)",
         report.check.error_us, report.check.bound_us);
  }
}

void Core::read_interlock() noexcept {
  const auto state = interlock_.get_state();
  if (state.mono_ns > 0) {
    supervisor_.on_interlock(state);
    now_.estop_closed = state.estop_closed;
    now_.guard_closed = state.guard_closed;
  }
  LinkHealth health;
  while (interlock_.health.pop(health)) now_.interlock = health;
}

void Core::supervise(std::int64_t now_ns) noexcept {
  Trip trip = supervisor_.check(now_ns);
  if (recorder_fault_.load(std::memory_order_relaxed) && trip.severity < Severity::kProgramStop) {
    trip = {Severity::kProgramStop, "recorder", "the recording cannot be continued; make room on the disk", 0.0, 0.0};
  }
  const bool live = state_ == RunState::kRunning || state_ == RunState::kPaused;
  if (live && !trip && loop_.unreachable()) {
    trip = {Severity::kProgramStop, "pressure.unreachable",
            "the set-point cannot be reached; check supply, leaks and the fill valve", pressure_psi_,
            loop_.target_psi()};
  }
  if (trip && (live || (state_ == RunState::kFaulted && trip.severity > (vented_fault_ ? Severity::kSafeState
                                                                                       : Severity::kProgramStop)))) {
    vented_fault_ = trip.severity == Severity::kSafeState;
    if (vented_fault_) {
      stop_and_vent(now_ns);
      if (run_open_) {
        run_open_ = false;
        outcome_ = Outcome::kFailed;
      }
    } else {
      send_stop();
      if (cursor_) cursor_->pause(now_ns);
    }
    keep_ = Keep::kFull;  // the run-up to the fault goes to disk in full, and some seconds of what follows
    faulted_since_ns_ = now_ns;
    FixedText text(now_.fault);
    text << trip.code << ": " << trip.what;
    if (trip.threshold != 0.0) text << " (" << trip.value << ", limit " << trip.threshold << ")";
    transition(now_ns, RunState::kFaulted, trip.severity, trip.code, trip.what, trip.value, trip.threshold);
    return;
  }

  const char* why = nullptr;
  const bool healthy = supervisor_.healthy(now_ns, &why) && frame_health_.clock_ready && pressure_health_.clock_ready;
  now_.healthy = healthy;
  if (state_ == RunState::kIdle || state_ == RunState::kReady) {
    if (why == nullptr || why[0] == '\0') why = healthy ? "" : "the device clocks are being measured";
    if (std::strncmp(now_.not_ready, why, sizeof now_.not_ready) != 0) copy_text(now_.not_ready, why);
    if (healthy != (state_ == RunState::kReady)) {
      transition(now_ns, healthy ? RunState::kReady : RunState::kIdle, Severity::kInfo, healthy ? "ready" : "not_ready",
                 healthy ? "all streams fresh, interlock closed, clocks mapped" : why, 0.0, 0.0);
    }
  } else if (state_ == RunState::kFaulted) {
    if (now_ns - faulted_since_ns_ > kEvidenceNs) keep_ = Keep::kAveraged;
  } else if (state_ == RunState::kStopping) {
    const double elapsed_s = static_cast<double>(now_ns - stopping_since_ns_) * 1e-9;
    const bool vented = pressure_psi_ < config_.vented_psi && !moving_;
    if (vented || elapsed_s > config_.vent_time_max_s) {
      if (!vented) {
        emit(now_ns, Severity::kWarning, "vent.slow", "the rig did not vent in time; check the dump valve", pressure_psi_,
             config_.vented_psi);
      }
      keep_ = Keep::kAveraged;
      transition(now_ns, RunState::kIdle, Severity::kInfo, "stopped", "frame stopped, pressure vented", pressure_psi_, 0.0);
    }
  }
}

void Core::step_plan(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kRunning) return;
  const protocol::Action& action = cursor_->advance(now_ns, seen_);
  keep_ = action.keep;
  step_ = action.step;
  if (action.step_began || action.step_ended) emit_step(now_ns, action);
  if (action.start_segment) {
    const auto& cal = config_.calibration;
    frame::Segment segment;
    segment.id = action.segment.id;
    segment.target_mm = static_cast<float>((action.segment.target_mm - cal.position_offset_mm) / cal.position_scale);
    segment.velocity_mm_s = static_cast<float>(action.segment.velocity_mm_s / std::abs(cal.position_scale));
    last_segment_id_ = segment.id;
    commanded_velocity_mm_s_ = std::copysign(action.segment.velocity_mm_s, action.segment.target_mm - seen_.position_mm);
    supervisor_.on_segment(segment, raw_position_mm_, now_ns);
    frame_.commands.push({FrameCommand::Kind::kSegment, segment});
  }
  if (action.rate_psi_s > 0.0 && action.setpoint_psi != setpoint_psi_) {
    setpoint_psi_ = action.setpoint_psi;
    loop_.set_target(setpoint_psi_, action.rate_psi_s, now_ns);
  }
  if (action.state == protocol::CursorState::kFinished) {
    end_run(now_ns, Outcome::kDone, "protocol finished: frame stops, pressure vents");
  } else if (action.state == protocol::CursorState::kFailed) {
    vented_fault_ = false;
    run_open_ = false;
    outcome_ = Outcome::kFailed;
    send_stop();
    FixedText text(now_.fault);
    text << "protocol: " << protocol::describe(action.failure) << " (" << action.failure_value << ", wanted "
         << action.failure_threshold << ")";
    transition(now_ns, RunState::kFaulted, Severity::kProgramStop, "protocol", protocol::describe(action.failure),
               action.failure_value, action.failure_threshold);
  }
}

void Core::command(std::int64_t) noexcept {
  pressure_.set_command(loop_.command());
  const auto beat = static_cast<std::uint32_t>(ticks_);
  frame_.loop_beat.store(beat, std::memory_order_release);
  pressure_.loop_beat.store(beat, std::memory_order_release);
  interlock_.loop_beat.store(beat, std::memory_order_release);
}

void Core::hand_off(std::int64_t now_ns) noexcept {
  if (now_ns < next_control_ns_) return;
  next_control_ns_ = now_ns + config_.control_period_ns;

  if (frame_health_.lost > frame_lost_) {
    emit(now_ns, Severity::kWarning, "lost.frame", "samples of the frame were overwritten before we read them",
         static_cast<double>(frame_health_.lost - frame_lost_), 0.0);
    frame_lost_ = frame_health_.lost;
  }
  if (pressure_health_.lost > pressure_lost_) {
    emit(now_ns, Severity::kWarning, "lost.pressure", "pressure samples are missing from the sequence",
         static_cast<double>(pressure_health_.lost - pressure_lost_), 0.0);
    pressure_lost_ = pressure_health_.lost;
  }
  const std::uint64_t drops = recorder_.dropped();
  if (drops > reported_drops_) {
    emit(now_ns, Severity::kWarning, "lost.record", "the recorder did not keep up; records were dropped",
         static_cast<double>(drops - reported_drops_), 0.0);
    reported_drops_ = drops;
  }

  ControlRecord& c = now_.control;
  c.mono_ns = now_ns;
  c.step = step_now();
  c.state = state_;
  c.setpoint_psi = static_cast<float>(loop_.target_psi());
  c.pressure_psi = static_cast<float>(pressure_psi_);
  c.fill_permille = loop_.command().fill_permille;
  c.vent_permille = loop_.command().vent_permille;
  c.position_mm = static_cast<float>(seen_.position_mm);
  c.force_N = static_cast<float>(seen_.force_N);
  c.ticks = ticks_;
  c.overruns = overruns_;
  c.worst_wakeup_ns = static_cast<std::uint32_t>(std::min<std::int64_t>(worst_wakeup_ns_, UINT32_MAX));
  c.worst_run_ns = static_cast<std::uint32_t>(std::min<std::int64_t>(worst_run_ns_, UINT32_MAX));
  if (cursor_) {
    const auto progress = cursor_->progress(now_ns);
    c.progress = static_cast<float>(progress.fraction);
    c.remaining_s = static_cast<float>(progress.remaining_s);
    c.target_mm = static_cast<float>(cursor_->action().segment.target_mm);
    c.velocity_mm_s = static_cast<float>(commanded_velocity_mm_s_);
    now_.session = cursor_->session();
    now_.repetition = plan_->steps[step_].repetition;
  }
  fan_out(&Streams::control, c);

  now_.run_loaded = run_open_;
  now_.outcome = outcome_;
  now_.vented_fault = vented_fault_;
  now_.frame_age_s = supervisor_.frame_age_s(now_ns);
  now_.pressure_age_s = supervisor_.pressure_age_s(now_ns);
  now_.frame = frame_health_;
  now_.pressure = pressure_health_;
  now_.records_dropped = drops;
  now_.publish_dropped = publisher_ == nullptr ? 0 : publisher_->dropped();
  now_.worst_wakeup_ns = std::max(now_.worst_wakeup_ns, c.worst_wakeup_ns);
  now_.worst_run_ns = std::max(now_.worst_run_ns, c.worst_run_ns);
  status_.store(now_);
  worst_wakeup_ns_ = 0;
  worst_run_ns_ = 0;
}

}  // namespace isorig::daemon
