#include "daemon/core/core.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "daemon/core/fixed_text.hpp"

namespace isorig::daemon {
namespace {

constexpr auto kEvidenceNs = static_cast<std::int64_t>(1e9 * kEvidence_s);
constexpr std::int64_t kLossesNs = 1'000'000'000;
// So long the vent stays open in any case: a sensor whose tube is off says at once that all is vented.
constexpr std::int64_t kLeastVentNs = 200'000'000;

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
      loop_(config.pressure_loop),
      guard_(config.pressure_loop, config.supervisor.limits.pressure_max_psi) {
  loop_.vent();
}

void Core::tick(std::int64_t now_ns, std::int64_t late_ns, std::int64_t last_run_ns) noexcept {
  ++ticks_;
  worst_wakeup_ns_ = std::max(worst_wakeup_ns_, late_ns);
  ++now_.lateness[lateness_bin(late_ns)];
  worst_run_ns_ = std::max(worst_run_ns_, last_run_ns);
  supervisor_.set_state(state_, run_open_);
  supervisor_.on_tick_lateness(now_ns, late_ns);

  if (run_open_ || (recorded_ && state_ == RunState::kStopping)) recorded_until_ns_ = now_ns + kRecordedAfterNs;
  recorded_ = now_ns < recorded_until_ns_;

  read_interlock();
  read_frame();
  read_pressure();
  // What the device did with commands that ran out while we were away is not the sensor's fault, and the readings of
  // that time are still coming in.
  if (static_cast<double>(late_ns) > 1e9 * config_.supervisor.late_tick_max_s)
    guard_.restart(now_ns + PressureGuard::kDelayNs);
  take_requests(now_ns);
  supervise(now_ns);
  step_plan(now_ns);
  command(now_ns);
  hand_off(now_ns);
}

/// What the records of all streams have in common.
template <typename Record, typename Sample>
Record Core::begin_record(const Stamped<Sample>& in) const noexcept {
  Record r;
  r.mono_ns = in.mono_ns;
  r.device_us = in.sample.device_us;
  r.sequence = in.sample.sequence;
  r.step = step_now();
  r.bound_ns = in.bound_ns;
  r.repeatability_ns = in.repeatability_ns;
  r.keep = keep_;
  return r;
}

void Core::read_frame() noexcept {
  Stamped<frame::Sample> in;
  force_new_ = 0;
  force_sum_N_ = 0.0;
  const auto& cal = config_.calibration;
  while (frame_.samples.pop(in)) {
    auto r = begin_record<FrameRecord>(in);
    r.raw_position_mm = in.sample.position_mm;
    r.raw_force_N = in.sample.force_N;
    r.position_mm = double{in.sample.position_mm} * cal.position_scale + cal.position_offset_mm;
    r.force_N = double{in.sample.force_N} * cal.force_scale + cal.force_offset_N;
    supervisor_.on_frame_sample(r);
    fan_out(&Streams::frame, r);
    if (!std::isfinite(r.position_mm) || !std::isfinite(r.force_N))
      continue;  // recorded as it came, and believed by nobody
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
    supervisor_.on_frame_report(report);
    watch_zero(report);
    // Of the segment that was commanded last, once the frame has taken it, and of none that it remembers from before.
    seen_.segment_reached = report.state.motion == frame::Motion::kReached && segments_commanded_ != 0 &&
                            report.taken_segment == segments_commanded_;
    seen_.segment_id = report.state.segment_id;
    frame_segment_id_ = report.state.segment_id;
    moving_ = report.state.motion == frame::Motion::kMoving;
    if (seen_.segment_reached) commanded_velocity_mm_s_ = 0.0;
  }
  clock::Exchange exchange;
  while (frame_.exchanges.pop(exchange)) {
    fan_out(&Streams::exchanges, ExchangeRecord{DeviceId::kFrame, exchange});
  }
  while (frame_.health.pop(now_.frame)) {
  }
}

void Core::read_pressure() noexcept {
  Stamped<pressure::Sample> in;
  const auto& cal = config_.calibration;
  while (pressure_.samples.pop(in)) {
    const auto reading = monitor_.update(in.sample.raw_word, in.sample.device_us, guard_.sure_rate_psi_s());
    auto r = begin_record<PressureRecord>(in);
    r.raw_word = in.sample.raw_word;
    r.status = static_cast<std::uint8_t>(reading.word.status);
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
    const double velocity_mm_s = moving_ ? commanded_velocity_mm_s_ : 0.0;
    guard_.on_reading(r.mono_ns, r.pressure_psi, velocity_mm_s, loop_.is_holding());
    loop_.update(r.mono_ns, r.pressure_psi, velocity_mm_s);
  }
  clock::Exchange exchange;
  while (pressure_.exchanges.pop(exchange)) {
    fan_out(&Streams::exchanges, ExchangeRecord{DeviceId::kPressure, exchange});
  }
  if (pressure_.sync.size() > 0) {
    SyncReport sync;
    while (pressure_.sync.pop(sync)) take_sync(sync);
  }
  pressure::State state;
  while (pressure_.states.pop(state)) {
    supervisor_.on_device_vented(state.vented_by_itself, state.cause);
  }
  while (pressure_.health.pop(now_.pressure)) {
  }
  while (pressure_.regulator_health.pop(now_.regulator)) {
  }
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
  while (interlock_.health.pop(now_.interlock)) {
  }
}

void Core::supervise(std::int64_t now_ns) noexcept {
  watch_itself(now_ns);
  while (storage_words_.pop(storage_)) {
  }
  if (take_trips(now_ns, supervisor_.check(now_ns))) return;

  // Only the status asks for it while a plan runs.
  const bool is_asked = state_ != RunState::kRunning || now_ns >= next_control_ns_;
  const char* why = is_asked ? why_not_ready(now_ns) : nullptr;
  if (is_asked) now_.healthy = why == nullptr;
  if (state_ == RunState::kIdle || state_ == RunState::kReady) {
    const char* text = why == nullptr ? "" : why;
    if (std::strncmp(now_.not_ready, text, sizeof now_.not_ready) != 0) copy_text(now_.not_ready, text);
    if ((why == nullptr) != (state_ == RunState::kReady)) {
      transition(now_ns, why == nullptr ? RunState::kReady : RunState::kIdle, Severity::kInfo,
                 why == nullptr ? "ready" : "not_ready",
                 why == nullptr ? "all streams fresh, interlock closed, clocks mapped, vented and at rest" : why, 0.0,
                 0.0);
    }
  } else if (state_ == RunState::kFaulted) {
    if (now_ns - faulted_since_ns_ > kEvidenceNs) keep_ = Keep::kAveraged;
    // By a reading from after the stop: an earlier one, of a sensor that has gone silent since, says nothing.
  } else if (state_ == RunState::kStopping && filter_last_ns_ > stopping_since_ns_ &&
             now_ns - stopping_since_ns_ > kLeastVentNs && pressure_psi_ < config_.vented_psi && supervisor_.stands()) {
    keep_ = Keep::kAveraged;
    const bool to_setup = setup_wanted_ && supervisor_.is_beyond_limit() && why_no_setup(now_ns) == nullptr;
    transition(now_ns, RunState::kIdle, Severity::kInfo, "stopped", "frame stopped, pressure vented", pressure_psi_,
               0.0);
    if (to_setup) enter_setup(now_ns, "a limit is still passed: jog back inside (isorig jog), then isorig setup --off");
  } else {
    watch_operator(now_ns, why);
  }
}

/// A run that is not recorded does not go on.
Trip Core::judge_recorder(std::int64_t now_ns) noexcept {
  while (recorder_faults_.pop(recorder_trouble_)) {
  }
  if (recorder_fault_.load(std::memory_order_acquire)) {
    return {Severity::kProgramStop, "recorder", recorder_trouble_.text, 0.0, 0.0};
  }
  const std::uint64_t dropped = recorder_.dropped();
  if (!run_open_) drops_before_run_ = dropped;
  if (dropped > drops_before_run_) {
    const auto lost = static_cast<double>(dropped - drops_before_run_);
    drops_before_run_ = dropped;
    return {Severity::kProgramStop, "recorder.overflow",
            "the recorder did not keep up and records are lost; check the disk", lost, 0.0};
  }
  const std::int64_t turn_ns = recorder_turn_ns_.load(std::memory_order_acquire);
  if (const double age_s = static_cast<double>(now_ns - turn_ns) * 1e-9;
      turn_ns > 0 && age_s > config_.recorder_age_max_s) {
    return {Severity::kProgramStop, "recorder.stalled", "the recorder stands still; check the disk", age_s,
            config_.recorder_age_max_s};
  }
  if (const double held = recorder_.fullest(); turn_ns > 0 && held > CoreConfig::kRecorderQueueMax) {
    return {Severity::kProgramStop, "recorder.stalled",
            "the recorder falls behind; check the disk (share of its queue)", held, CoreConfig::kRecorderQueueMax};
  }
  return {};
}

void Core::step_plan(std::int64_t now_ns) noexcept {
  if (state_ != RunState::kRunning) return;
  const protocol::Action& action = cursor_->advance(now_ns, seen_);
  keep_ = action.keep;
  step_ = action.step;
  if (action.step_began || action.step_ended) emit_step(now_ns, action);
  // One that failed meanwhile does not go on.
  if (action.state != protocol::CursorState::kFailed && action.regaining != regaining_) {
    regaining_ = action.regaining;
    if (regaining_) {
      emit(now_ns, Severity::kWarning, "resume.pressure", "the pressure is off its set-point: the step waits for it",
           pressure_psi_, action.setpoint_psi);
    } else {
      emit(now_ns, Severity::kInfo, "resume.pressure", "the step goes on", pressure_psi_, action.setpoint_psi);
    }
  }
  if (action.start_segment) {
    if (!move_to(now_ns, action.segment.id, action.segment.target_mm, action.segment.velocity_mm_s)) return;
  }
  if (action.rate_psi_s > 0.0 && action.setpoint_psi != setpoint_psi_) {
    setpoint_psi_ = action.setpoint_psi;
    loop_.set_target(setpoint_psi_, action.rate_psi_s, now_ns);
  }
  if (action.state == protocol::CursorState::kFinished) {
    end_run(now_ns, Outcome::kDone, "protocol finished: frame stops, pressure vents");
  } else if (action.state == protocol::CursorState::kFailed) {
    // The run is over: there is nothing to hold the pressure for.
    trip_over(now_ns, {severity_of("protocol", Phase::kHolding), "protocol", protocol::describe(action.failure),
                       action.failure_value, action.failure_threshold});
  }
}

/// The plan counts calibrated, the frame raw.
bool Core::move_to(std::int64_t now_ns, std::uint16_t id, double target_mm, double velocity_mm_s) noexcept {
  if (const auto kept = supervisor_.binding(target_mm)) {
    trip_over(now_ns, {Severity::kProgramStop, kept->code, kept->why, kept->value, kept->threshold});
    return false;
  }
  const auto& cal = config_.calibration;
  frame::Segment segment;
  segment.id = id;
  segment.target_mm = static_cast<float>((target_mm - cal.position_offset_mm) / cal.position_scale);
  segment.velocity_mm_s = static_cast<float>(velocity_mm_s / std::abs(cal.position_scale));
  commanded_target_mm_ = target_mm;
  commanded_velocity_mm_s_ = std::copysign(velocity_mm_s, target_mm - seen_.position_mm);
  ++segments_commanded_;
  supervisor_.on_segment(segment, segments_commanded_, raw_position_mm_, now_ns);
  frame_.commands.push({segment, segments_commanded_, stops_requested_});
  return true;
}

void Core::command(std::int64_t now_ns) noexcept {
  pressure_.set_command(loop_.command());
  guard_.on_command(now_ns, loop_.command());
  const auto beat = static_cast<std::uint32_t>(ticks_);
  frame_.loop_beat.store(beat, std::memory_order_release);
  pressure_.loop_beat.store(beat, std::memory_order_release);
  interlock_.loop_beat.store(beat, std::memory_order_release);
}

void Core::hand_off(std::int64_t now_ns) noexcept {
  if (now_ns < next_control_ns_) return;
  next_control_ns_ = now_ns + config_.control_period_ns;

  // Summed up once a second: a loss that goes on must not push everything else out of the events.
  const bool tell_losses = now_ns >= next_loss_ns_;
  follow_links(now_ns, tell_losses);
  const std::uint64_t drops = recorder_.dropped();
  if (tell_losses && drops > reported_drops_) {
    emit(now_ns, Severity::kWarning, "lost.record", "the recorder did not keep up; records were dropped",
         static_cast<double>(drops - reported_drops_), 0.0);
    reported_drops_ = drops;
  }
  if (tell_losses) next_loss_ns_ = now_ns + kLossesNs;

  ControlRecord& c = now_.control;
  c.mono_ns = now_ns;
  c.step = step_now();
  c.state = state_;
  c.setpoint_psi = static_cast<float>(loop_.target_psi());
  c.pressure_psi = static_cast<float>(pressure_psi_);
  c.fill_permille = loop_.command().fill_permille;
  c.vent_permille = loop_.command().vent_permille;
  const bool by_plan = cursor_ && run_open_ && run_begun_;
  c.target_mm = static_cast<float>(by_plan ? cursor_->action().segment.target_mm : commanded_target_mm_);
  c.velocity_mm_s = static_cast<float>(commanded_velocity_mm_s_);
  c.position_mm = static_cast<float>(seen_.position_mm);
  c.force_N = static_cast<float>(seen_.force_N);
  c.ticks = ticks_;
  c.overruns = overruns_;
  c.worst_wakeup_ns = static_cast<std::uint32_t>(std::min<std::int64_t>(worst_wakeup_ns_, UINT32_MAX));
  c.worst_run_ns = static_cast<std::uint32_t>(std::min<std::int64_t>(worst_run_ns_, UINT32_MAX));
  if (by_plan) {
    const auto progress = cursor_->progress(now_ns);
    c.progress = static_cast<float>(progress.fraction);
    c.remaining_s = static_cast<float>(progress.remaining_s);
    now_.session = cursor_->session();
    now_.repetition = plan_->steps[step_].repetition;
  }
  fan_out(&Streams::control, c);

  now_.run_loaded = run_open_;
  now_.outcome = outcome_;
  now_.stopped = is_stopped(now_ns);
  now_.sealed = loop_.is_shut();
  now_.vented_fault = vented_fault_;
  now_.operator_left_s = static_cast<float>(operator_left_s(now_ns));
  now_.zero_confirmed = zero_epoch_ != 0 && zero_epoch_ == confirmed_zero_;
  now_.frame_age_s = supervisor_.frame_age_s(now_ns);
  now_.pressure_age_s = supervisor_.pressure_age_s(now_ns);
  now_.records_dropped = drops;
  now_.publish_dropped = publisher_ == nullptr ? 0 : publisher_->dropped();
  now_.worst_wakeup_ns = std::max(now_.worst_wakeup_ns, c.worst_wakeup_ns);
  now_.worst_run_ns = std::max(now_.worst_run_ns, c.worst_run_ns);
  if (list_changed_) faults_.store(listed_);
  list_changed_ = false;
  status_.store(now_);
  worst_wakeup_ns_ = 0;
  worst_run_ns_ = 0;
  for (std::size_t i = 0; i < answered_count_; ++i) replies.push(answered_[i]);
  answered_count_ = 0;
}

}  // namespace isorig::daemon
