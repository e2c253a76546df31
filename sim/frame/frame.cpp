#include "sim/frame/frame.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

namespace isorig::sim {
namespace {
constexpr std::int64_t kHeartbeatCheck_ns = 10'000'000;  // heartbeat supervision: 10 ms resolution
constexpr std::int64_t kInPositionTime_ns = 20'000'000;

}  // namespace

SimFrame::SimFrame(const FrameParameters& p, Host& host, std::uint64_t seed, std::int64_t start_ns, double dt_s)
    : p_(p),
      host_(host),
      crosshead_(p, dt_s),
      clock_(p.clock, random_of(seed, Stream::kFrameClock), start_ns),
      force_noise_(random_of(seed, Stream::kFrameForce)),
      position_noise_(random_of(seed, Stream::kFramePosition)),
      request_(p.request, random_of(seed, Stream::kFrameRequest)),
      reply_(p.reply, random_of(seed, Stream::kFrameReply)),
      inverse_force_quantum_(1.0 / p.force_quantum_N),
      inverse_position_quantum_(1.0 / p.position_quantum_mm),
      sample_period_us_(1e6 / p.sample_rate_hz),
      ring_(static_cast<std::size_t>(p.ring_samples)),
      next_sample_us_((std::floor(p.clock.offset_us / sample_period_us_) + 1.0) * sample_period_us_),
      start_ns_(start_ns),
      next_check_ns_(start_ns),
      next_exchange_ns_(start_ns),
      burst_left_(p.exchange_burst) {}

void SimFrame::require_link() const {
  if (faults.silent) throw drivers::DeviceError(drivers::Fault::kTimeout, "simulated frame: no answer");
  if (faults.disconnected) {
    throw drivers::DeviceError(drivers::Fault::kDisconnected, "simulated frame: connection lost");
  }
  if (!connected_) {
    throw drivers::DeviceError(drivers::Fault::kDisconnected, "simulated frame: not connected, call connect()");
  }
}

bool SimFrame::spend(int& count) noexcept {
  const bool broken = count != 0;
  if (count > 0) --count;
  return broken;
}

/// What may become of the answer to a poll.
void SimFrame::answer_poll() {
  using drivers::DeviceError;
  using drivers::Fault;
  require_link();
  if (spend(faults.polls_lost)) throw DeviceError(Fault::kTimeout, "simulated frame: no answer");
  if (spend(faults.polls_spoilt)) throw DeviceError(Fault::kProtocol, "simulated frame: a spoilt answer");
  if (spend(faults.polls_refused)) throw DeviceError(Fault::kRefused, "simulated frame: exception 4");
}

frame::Identity SimFrame::connect() {
  const auto visit = host_.enter();
  connected_ = true;
  try {
    require_link();
  } catch (...) {
    connected_ = false;
    throw;
  }
  read_ = sequence_;  // what was sampled before we came is not a loss
  burst_left_ = p_.exchange_burst;
  next_exchange_ns_ = visit.now_ns;
  return {"isorig", "simulated frame", "SIM-FRAME-1", "1.0", p_.sample_rate_hz, reference_epoch_};
}

frame::Poll SimFrame::poll(std::span<frame::Sample> out) {
  const auto visit = host_.enter();
  answer_poll();
  frame::Poll poll;
  const double now_ns = static_cast<double>(visit.now_ns);
  double answered_ns = now_ns - reply_.base_ns();
  if (burst_left_ > 0 || visit.now_ns >= next_exchange_ns_) {
    // The call returns now: its request left, and its answer was made, that much earlier.
    answered_ns = now_ns - reply_.next_ns();
    const double sent_ns = answered_ns - request_.next_ns();
    const double stamp_us = std::floor(clock_.device_us(answered_ns));
    poll.has_exchange = true;
    // One stamp, floored to 1 us: the half microsecond put back keeps it unbiased; causality still holds,
    // since half a microsecond is far below any base delay.
    poll.exchange = {static_cast<std::int64_t>(sent_ns), visit.now_ns, stamp_us + 0.5, stamp_us + 0.5};
    if (burst_left_ > 0) --burst_left_;
    next_exchange_ns_ = visit.now_ns + static_cast<std::int64_t>(p_.exchange_interval_ms * 1e6);
  }
  const double until_us = clock_.device_us(answered_ns);
  const auto capacity = static_cast<std::uint32_t>(ring_.size());
  if (sequence_ - read_ > capacity) {
    poll.lost = sequence_ - read_ - capacity;
    read_ = sequence_ - capacity;
    state_.fault_bits |= frame::kSampleBufferOverrun;
  } else {
    state_.fault_bits &= static_cast<std::uint16_t>(~frame::kSampleBufferOverrun);
  }
  const std::uint32_t waiting = sequence_ - read_;
  std::size_t slot = write_slot_ >= waiting ? write_slot_ - waiting : write_slot_ + capacity - waiting;
  while (read_ != sequence_ && poll.samples < out.size()) {
    const frame::Sample& sample = ring_[slot];
    if (static_cast<double>(sample.device_us) > until_us) break;
    out[poll.samples++] = sample;
    slot = slot + 1 == capacity ? 0 : slot + 1;
    ++read_;
  }
  if (!faults.frozen_registers) said_ = state_;
  poll.state = said_;
  if (faults.fault_state) poll.state.motion = frame::Motion::kFault;
  return poll;
}

void SimFrame::start_segment(const frame::Segment& segment) {
  const auto visit = host_.enter();
  require_link();
  const auto refuse = [](const std::string& why) {
    throw drivers::DeviceError(drivers::Fault::kRefused, "simulated frame refuses the segment: " + why);
  };
  if (spend(faults.segments_refused)) refuse("exception 4");
  if (!std::isfinite(segment.target_mm) || !(segment.velocity_mm_s > 0.0F))
    refuse("target or velocity is not a number above 0");
  if (static_cast<double>(segment.velocity_mm_s) > p_.speed_max_mm_s * (1.0 + 1e-6))
    refuse("faster than the frame's speed_max_mm_s");
  const double target_mm = (static_cast<double>(segment.target_mm) - p_.zero_mm) / p_.position_gain;
  if (target_mm > p_.travel_max_mm || target_mm < p_.travel_min_mm) refuse("target outside the frame's travel limits");
  if (!drive_enabled_) refuse("the drive is disabled (interlock open)");
  if (faults.drive_fault) refuse("drive fault");
  if (!heartbeat_seen_ || (state_.fault_bits & frame::kHeartbeatLost) != 0) refuse("no heartbeat");
  const double away = target_mm - crosshead_.position_mm();
  if ((state_.fault_bits & frame::kForceLimit) != 0) {
    // Tension falls when the specimen shortens: only the direction that unloads is let through.
    const bool unloads = static_cast<double>(last_force_N_) > 0.0 ? away < 0.0 : away > 0.0;
    if (!unloads) refuse("the force limit is reached in this direction");
  }
  state_.fault_bits &= static_cast<std::uint16_t>(~(frame::kForceLimit | frame::kTravelLimit));
  state_.segment_id = segment.id;
  state_.target_mm = segment.target_mm;
  state_.velocity_mm_s = segment.velocity_mm_s;
  state_.motion = frame::Motion::kMoving;
  waiting_ = segment;
  if (faults.echoes_wrong) state_.target_mm = waiting_.target_mm = segment.target_mm + 0.5F;
  if (faults.overshoot_mm != 0.0) {
    waiting_.target_mm += static_cast<float>(std::copysign(faults.overshoot_mm, away) * p_.position_gain);
  }
  pending_ = true;
  pending_ns_ = visit.now_ns + static_cast<std::int64_t>(p_.command_delay_ms * 1e6);
}

void SimFrame::stop() {
  const auto visit = host_.enter();
  require_link();
  if (spend(faults.stop_refused)) {
    throw drivers::DeviceError(drivers::Fault::kRefused, "simulated frame refuses the stop: busy");
  }
  if (spend(faults.stop_lost)) return;
  pending_ = false;
  if (state_.motion == frame::Motion::kMoving) {
    if (!faults.runs_on && !faults.runaway) crosshead_.stop();
    moving_ = false;
    state_.motion = frame::Motion::kStopped;
  }
}

void SimFrame::power_cycle(double zero_shift_mm) noexcept {
  crosshead_.stop();
  pending_ = moving_ = connected_ = heartbeat_seen_ = false;
  ++reference_epoch_;
  state_ = {};
  p_.zero_mm += zero_shift_mm;
}

void SimFrame::heartbeat(std::uint16_t counter) {
  const auto visit = host_.enter();
  require_link();
  if (faults.heartbeat_refused) {
    throw drivers::DeviceError(drivers::Fault::kRefused, "simulated frame refuses the heartbeat");
  }
  if (!heartbeat_seen_ || counter != state_.heartbeat_echo) {
    heartbeat_seen_ = true;
    heartbeat_ns_ = visit.now_ns;
    state_.fault_bits &= static_cast<std::uint16_t>(~frame::kHeartbeatLost);
  }
  state_.heartbeat_echo = counter;
}

void SimFrame::halt(frame::Motion motion, std::uint16_t fault) noexcept {
  state_.fault_bits |= fault;
  state_.motion = motion;
  pending_ = false;
  moving_ = false;
}

void SimFrame::check(std::int64_t now_ns, bool drive_enabled) noexcept {
  next_check_ns_ = now_ns + kHeartbeatCheck_ns;
  const bool powered = drive_enabled && !faults.drive_fault;
  if (!powered) {
    if (!crosshead_.braking()) crosshead_.brake();
    const auto fault = static_cast<std::uint16_t>((drive_enabled ? 0 : frame::kInterlockOpen) |
                                                  (faults.drive_fault ? frame::kDriveFault : 0));
    halt(faults.drive_fault ? frame::Motion::kFault : frame::Motion::kDisabled, fault);
  } else if (crosshead_.braking() && crosshead_.resting()) {
    crosshead_.release();
    state_.motion = frame::Motion::kStopped;
  }
  if (drive_enabled) state_.fault_bits &= static_cast<std::uint16_t>(~frame::kInterlockOpen);
  if (!faults.drive_fault) state_.fault_bits &= static_cast<std::uint16_t>(~frame::kDriveFault);
  drive_enabled_ = drive_enabled;

  if (heartbeat_seen_ && (state_.fault_bits & frame::kHeartbeatLost) == 0 &&
      static_cast<double>(now_ns - heartbeat_ns_) > p_.heartbeat_timeout_s * 1e9) {
    const bool was_moving = state_.motion == frame::Motion::kMoving;
    if (!faults.runaway) crosshead_.stop();
    halt(was_moving ? frame::Motion::kStopped : state_.motion, frame::kHeartbeatLost);
  }
  if (pending_ && now_ns >= pending_ns_) {
    pending_ = false;
    moving_ = true;
    in_position_ns_ = -1;
    ignored_ = faults.ignores_segments;
    if (!ignored_) {
      crosshead_.move((static_cast<double>(waiting_.target_mm) - p_.zero_mm) / p_.position_gain,
                      static_cast<double>(waiting_.velocity_mm_s) / p_.position_gain);
    }
  }
}

void SimFrame::supervise_motion(const StepView& step) noexcept {
  const double position_mm = step.position_end_mm;
  const double force_N = step.force_end_N;
  if (force_N > p_.force_max_N || force_N < p_.force_min_N) {
    const double velocity = crosshead_.velocity_mm_s();
    if ((force_N > 0.0) == (velocity > 0.0) && (state_.fault_bits & frame::kForceLimit) == 0) {
      crosshead_.stop();
      halt(frame::Motion::kLimit, frame::kForceLimit);
      return;
    }
  }
  if ((position_mm > p_.travel_max_mm && crosshead_.velocity_mm_s() > 0.0) ||
      (position_mm < p_.travel_min_mm && crosshead_.velocity_mm_s() < 0.0)) {
    crosshead_.stop();
    halt(frame::Motion::kLimit, frame::kTravelLimit);
    return;
  }
  if (!moving_ || ignored_ || faults.never_reached || !crosshead_.reference_at_target()) return;
  if (std::abs(position_mm - crosshead_.target_mm()) > p_.in_position_mm) {
    in_position_ns_ = -1;
    return;
  }
  const std::int64_t now_ns = step.begin_ns + step.length_ns;
  if (in_position_ns_ < 0) in_position_ns_ = now_ns;
  if (crosshead_.resting() || now_ns - in_position_ns_ >= kInPositionTime_ns) {
    moving_ = false;
    state_.motion = frame::Motion::kReached;
  }
}

frame::Sample SimFrame::sample(const StepView& step, double fraction, double device_us) noexcept {
  const double position_mm =
      p_.position_gain * (step.position_begin_mm + fraction * (step.position_end_mm - step.position_begin_mm)) +
      p_.zero_mm;
  double force_N = step.force_begin_N + fraction * (step.force_end_N - step.force_begin_N);
  force_N = p_.force_gain * force_N + p_.force_offset_N;
  if (p_.force_drift_N_h != 0.0) {
    force_N += p_.force_drift_N_h * static_cast<double>(step.begin_ns - start_ns_) / 3.6e12;
  }
  frame::Sample s;
  s.sequence = sequence_;
  s.device_us = static_cast<std::int64_t>(device_us);
  s.position_mm = static_cast<float>(quantise(position_mm + p_.position_noise_mm * position_noise_.normal(),
                                              p_.position_quantum_mm, inverse_position_quantum_));
  if (!faults.frozen_force) {
    last_force_N_ =
        static_cast<float>(quantise(force_N + faults.force_error_N + p_.force_noise_N * force_noise_.normal(),
                                    p_.force_quantum_N, inverse_force_quantum_));
  }
  s.force_N = faults.not_a_number ? std::numeric_limits<float>::quiet_NaN() : last_force_N_;
  return s;
}

void SimFrame::after_step(const StepView& step) noexcept {
  if (!crosshead_.resting() || moving_) supervise_motion(step);
  clock_.advance_to(step.begin_ns);
  const double length_ns = static_cast<double>(step.length_ns);
  while (!clock_.is_far_after(step.begin_ns, length_ns, next_sample_us_)) {
    const double at_ns = clock_.host_since(step.begin_ns, next_sample_us_);
    if (at_ns > length_ns) break;
    if (!faults.frozen_samples && !faults.frozen_registers) {
      ring_[write_slot_] = sample(step, at_ns / length_ns, next_sample_us_);
      write_slot_ = write_slot_ + 1 == ring_.size() ? 0 : write_slot_ + 1;
      ++sequence_;
    }
    next_sample_us_ += sample_period_us_;
  }
}

}  // namespace isorig::sim
