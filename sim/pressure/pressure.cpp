#include "sim/pressure/pressure.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "messages/elvh.hpp"

namespace isorig::sim {
namespace {
constexpr std::int64_t kWatchdogCheck_ns = 10'000'000;  // watchdog resolution
constexpr std::int64_t kTemperatureInterval_ns = 1'000'000'000;
constexpr double kTemperaturePeriod_s = 7200.0;

/// One of so many; -1 never runs out.
bool take_fault(int& left) noexcept {
  const bool strikes = left != 0;
  if (left > 0) --left;
  return strikes;
}

}  // namespace

SimPressure::SimPressure(const SensorParameters& p, const PneumaticParameters& valves, Host& host, std::uint64_t seed,
                         std::int64_t start_ns)
    : p_(p),
      host_(host),
      duty_dead_(valves.duty_dead_permille),
      duty_step_(valves.duty_step_permille),
      command_delay_ns_(static_cast<std::int64_t>((p.command_delay_ms + valves.valve_delay_ms) * 1e6)),
      command_validity_ns_(static_cast<std::int64_t>(p.command_validity_ms * 1e6)),
      start_ns_(start_ns),
      clock_(p.clock, random_of(seed, Stream::kSensorClock), start_ns),
      noise_(random_of(seed, Stream::kSensorNoise)),
      request_(p.request, random_of(seed, Stream::kSensorRequest)),
      reply_(p.reply, random_of(seed, Stream::kSensorReply)),
      sample_period_us_(1e6 / p.sample_rate_hz),
      next_sample_us_((std::floor(p.clock.offset_us / sample_period_us_) + 1.0) * sample_period_us_),
      next_temperature_ns_(start_ns),
      ring_(static_cast<std::size_t>(p.ring_samples)),
      sync_line_(start_ns),
      next_check_ns_(start_ns) {
  state_.vent_permille = 1000;
}

void SimPressure::require_link() const {
  if (!connected_ || faults.disconnected) {
    throw drivers::DeviceError(drivers::Fault::kDisconnected,
                               connected_ ? "simulated pressure device: connection lost"
                                          : "simulated pressure device: not connected, call connect()");
  }
}

void SimPressure::set_limits(const pressure::FillLimits& limits) {
  const auto visit = host_.enter();
  const double counts = limits.pressure_max_psi / messages::kElvhPsiPerCount + messages::kElvhOffsetCounts;
  messages::teensy::Limits wanted;
  wanted.pressure_max_raw = static_cast<std::uint16_t>(std::clamp(std::floor(counts), 0.0, 14'746.0));
  wanted.fill_allowance_permille = limits.fill_allowance_permille;
  wanted.fill_max_ms = limits.fill_max_ms;
  limits_ = wanted;
  if (!guard_.set_limits(wanted)) {
    throw drivers::DeviceError(drivers::Fault::kIdentity, "simulated pressure device: refuses these limits");
  }
  guards_ = true;
}

pressure::Identity SimPressure::connect() {
  const auto visit = host_.enter();
  connected_ = true;
  try {
    require_link();
  } catch (...) {
    connected_ = false;
    throw;
  }
  // A device that was restarted has forgotten them.
  if (limits_.pressure_max_raw != 0 && !guards_) guards_ = guard_.set_limits(limits_);
  stored_ = 0;
  expected_ = sequence_;
  replies_pending_ = 0;
  return {"isorig simulated Teensy with ELVH-030G", "SIM-PRESSURE-1", "1.0", messages::teensy::kProtocolVersion,
          p_.sample_rate_hz};
}

pressure::Poll SimPressure::poll(std::span<pressure::Sample> samples_out, std::span<clock::Exchange> exchanges_out,
                                 std::int64_t /*timeout_ns: the plant never blocks*/) {
  const auto visit = host_.enter();
  require_link();
  pressure::Poll poll;
  poll.state = state_;
  poll.state.dropped = dropped_;
  if (faults.silent) return poll;
  poll.corrupt = std::exchange(spoilt_, 0);
  const double now_ns = static_cast<double>(visit.now_ns);
  const double until_us = clock_.device_us(now_ns - 1e6 * p_.sample_latency_ms);
  while (stored_ > 0 && poll.samples < samples_out.size()) {
    const pressure::Sample& sample = ring_[oldest_];
    if (static_cast<double>(sample.device_us) > until_us) break;
    poll.lost += sample.sequence - expected_;
    expected_ = sample.sequence + 1;
    samples_out[poll.samples++] = sample;
    oldest_ = oldest_ + 1 == ring_.size() ? 0 : oldest_ + 1;
    --stored_;
  }
  for (std::size_t i = 0; i < replies_pending_ && poll.exchanges < exchanges_out.size();) {
    if (replies_[i].at_ns > now_ns) {
      ++i;
      continue;
    }
    exchanges_out[poll.exchanges++] = replies_[i].exchange;
    std::copy(replies_.begin() + static_cast<std::ptrdiff_t>(i) + 1,
              replies_.begin() + static_cast<std::ptrdiff_t>(replies_pending_),
              replies_.begin() + static_cast<std::ptrdiff_t>(i));
    --replies_pending_;
  }
  return poll;
}

void SimPressure::command(const pressure::Command& command) {
  const auto visit = host_.enter();
  require_link();
  if (command.fill_permille > 1000 || command.vent_permille > 1000) {
    throw drivers::DeviceError(drivers::Fault::kRefused, "simulated pressure device: a duty is above 1000 permille");
  }
  if (queue_write_ - queue_read_ == kQueue) ++queue_read_;  // faster than the delay allows: the oldest is overtaken
  queue_[queue_write_++ % kQueue] = {visit.now_ns + command_delay_ns_, command.fill_permille, command.vent_permille};
}

void SimPressure::heartbeat() {
  const auto visit = host_.enter();
  require_link();
  heartbeat_seen_ = true;
  heartbeat_ns_ = visit.now_ns;
}

void SimPressure::request_time_sync() {
  const auto visit = host_.enter();
  require_link();
  if (replies_pending_ == kQueue) return;  // nobody reads: the reply would be lost as well
  const double sent_ns = static_cast<double>(visit.now_ns);
  const double received_ns = sent_ns + request_.next_ns();
  const double answered_ns = received_ns + 1e3 * p_.turnaround_us;
  const double arrived_ns = answered_ns + reply_.next_ns();
  // micros() truncates; the half microsecond put back keeps the stamps unbiased.
  replies_[replies_pending_++] = {
      arrived_ns,
      {visit.now_ns, static_cast<std::int64_t>(std::ceil(arrived_ns)), std::floor(clock_.device_us(received_ns)) + 0.5,
       std::floor(clock_.device_us(answered_ns)) + 0.5}};
}

std::optional<pressure::SyncEdge> SimPressure::take_sync_edge() {
  const auto visit = host_.enter();
  require_link();
  std::int64_t edge_ns = 0;
  bool rising = false;
  if (faults.silent || !sync_line_.next(visit.now_ns, edge_ns, rising)) return std::nullopt;
  return pressure::SyncEdge{static_cast<std::int64_t>(clock_.device_us(static_cast<double>(edge_ns))), rising};
}

void SimPressure::power_cycle() noexcept {
  connected_ = heartbeat_seen_ = false;
  clock_.jump(-clock_.device_us(static_cast<double>(next_check_ns_)));
  next_sample_us_ = sample_period_us_;
  sequence_ = expected_ = dropped_ = spoilt_ = 0;
  stored_ = replies_pending_ = 0;
  queue_read_ = queue_write_;
  guard_ = {};
  guards_ = false;
  state_ = {};
  state_.vent_permille = 1000;
  targets_ = {};
}

double SimPressure::opening(std::uint16_t permille) const noexcept {
  const double duty = std::floor(static_cast<double>(permille) / duty_step_ + 0.5) * duty_step_;
  return std::clamp((duty - duty_dead_) / (1000.0 - duty_dead_), 0.0, 1.0);
}

void SimPressure::check(std::int64_t now_ns) noexcept {
  if (now_ns >= next_check_ns_) next_check_ns_ = now_ns + kWatchdogCheck_ns;
  const bool alive = heartbeat_seen_ && static_cast<double>(now_ns - heartbeat_ns_) <= p_.watchdog_s * 1e9;
  if (!alive) {
    if (heartbeat_seen_) vent_itself(messages::teensy::VentCause::kHeartbeat, now_ns);
    queue_read_ = queue_write_;
    return;
  }
  while (queue_read_ != queue_write_ && queue_[queue_read_ % kQueue].at_ns <= now_ns) {
    const Pending& next = queue_[queue_read_++ % kQueue];
    commanded_ns_ = now_ns;
    if (faults.ignores_commands) continue;
    const bool vents = next.fill_permille == 0 && next.vent_permille == 1000;
    if (state_.vented_by_itself && !vents) continue;
    state_.vented_by_itself = false;
    drive(next.fill_permille, next.vent_permille, now_ns);
  }
  if (!guards_) return;
  const bool vents = state_.fill_permille == 0 && state_.vent_permille == 1000;
  if (!vents && !faults.ignores_commands && now_ns - commanded_ns_ > command_validity_ns_) drive(0, 0, now_ns);
  if (const auto cause = guard_.tick(static_cast<std::uint64_t>(now_ns / 1000));
      cause != messages::teensy::VentCause::kNone)
    vent_itself(cause, now_ns);
}

void SimPressure::drive(std::uint16_t fill_permille, std::uint16_t vent_permille, std::int64_t now_ns) noexcept {
  guard_.apply(fill_permille, vent_permille, static_cast<std::uint64_t>(now_ns / 1000));
  state_.fill_permille = fill_permille;
  state_.vent_permille = vent_permille;
  targets_.fill = opening(fill_permille);
  targets_.vent = opening(vent_permille);
}

void SimPressure::vent_itself(messages::teensy::VentCause cause, std::int64_t now_ns) noexcept {
  if (state_.fill_permille == 0 && state_.vent_permille == 1000) return;
  drive(0, 1000, now_ns);
  state_.vented_by_itself = true;
  state_.cause = static_cast<pressure::VentCause>(cause);
}

double SimPressure::through_tube(double pressure_psi) noexcept {
  if (faults.tube_off) {
    at_sensor_psi_ = 0.0;
  } else if (faults.tube_lag_ms > 0) {
    const double step = 1.0 - std::exp(-1e-3 * sample_period_us_ / faults.tube_lag_ms);
    at_sensor_psi_ += step * (pressure_psi - at_sensor_psi_);
  } else if (!faults.tube_blocked) {
    at_sensor_psi_ = pressure_psi;
  }
  drifted_psi_ = faults.drift_psi_s == 0.0 ? 0.0 : drifted_psi_ + faults.drift_psi_s * 1e-6 * sample_period_us_;
  return at_sensor_psi_ * (1.0 - 1e-3 * faults.low_permille) + drifted_psi_;
}

std::uint32_t SimPressure::convert(double pressure_psi) noexcept {
  const double sensed_psi = through_tube(pressure_psi);
  if (faults.bus_low) return 0;
  if (faults.bus_high) return 0xFFFFFFFFU;
  if (faults.stuck_value) return last_word_;
  if (faults.sensor_stale) return (last_word_ & 0x3FFFFFFFU) | 0x80000000U;
  const double noise_psi = p_.noise_counts * messages::kElvhPsiPerCount * noise_.normal();
  last_word_ = messages::encode_elvh(p_.gain * sensed_psi + p_.offset_psi + noise_psi, temperature_C_);
  return faults.sensor_fault ? last_word_ | 0xC0000000U : last_word_;
}

void SimPressure::after_step(const StepView& step) noexcept {
  clock_.advance_to(step.begin_ns);
  if (step.begin_ns >= next_temperature_ns_) {
    next_temperature_ns_ += kTemperatureInterval_ns;
    const double t_s = 1e-9 * static_cast<double>(step.begin_ns - start_ns_);
    temperature_C_ =
        p_.temperature_C + p_.temperature_swing_C * std::sin(2.0 * std::numbers::pi * t_s / kTemperaturePeriod_s);
  }
  const double length_ns = static_cast<double>(step.length_ns);
  while (!clock_.is_far_after(step.begin_ns, length_ns, next_sample_us_)) {
    const double at_ns = clock_.host_since(step.begin_ns, next_sample_us_);
    if (at_ns > length_ns) break;
    if (!faults.frozen_samples) {
      const double pressure_psi =
          step.pressure_begin_psi + at_ns / length_ns * (step.pressure_end_psi - step.pressure_begin_psi);
      const std::uint32_t word = convert(pressure_psi);
      if (guards_) {
        const std::int64_t now_ns = step.begin_ns + static_cast<std::int64_t>(at_ns);
        const auto cause = guard_.sample(word, static_cast<std::uint64_t>(now_ns / 1000));
        if (cause != messages::teensy::VentCause::kNone) vent_itself(cause, now_ns);
      }
      if (take_fault(faults.samples_spoilt)) {
        ++spoilt_;
      } else if (take_fault(faults.samples_lost)) {
        // its number is missing
      } else if (stored_ == ring_.size()) {
        ++dropped_;
      } else {
        std::size_t slot = oldest_ + stored_++;
        if (slot >= ring_.size()) slot -= ring_.size();
        ring_[slot] = {sequence_, static_cast<std::int64_t>(next_sample_us_), word};
      }
      ++sequence_;
    }
    next_sample_us_ += sample_period_us_;
  }
}

}  // namespace isorig::sim
