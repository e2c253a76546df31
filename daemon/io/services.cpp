#include "daemon/io/services.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <span>

#include "daemon/core/fixed_text.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kHealthPeriodNs = 100'000'000;
// A loop that has not ticked for this long no longer holds the dump valve.
constexpr std::int64_t kLoopDeadNs = 500'000'000;

// A chip that is plugged in again enumerates in some tenths of a second.
constexpr std::int64_t kInterlockRetryNs = 500'000'000;

// Finer steps of a set-point are the trim's, and wait until they have added up.
constexpr float kSetpointStepPsi = 0.005F;
constexpr float kSetpointLostPsi = 0.05F;

}  // namespace

void PressureService::run_once(std::int64_t now_ns, std::int64_t wait_ns) noexcept {
  try {
    turn(now_ns, wait_ns);
  } catch (const drivers::DeviceError& error) {
    fail(now_ns, error);
  } catch (const std::exception& error) {
    fail(now_ns, drivers::DeviceError(drivers::Fault::kDisconnected, error.what()));
  }
  report_health(now_ns, link_.health, false);
}

void PressureService::turn(std::int64_t now_ns, std::int64_t wait_ns) {
  if (!health_.connected) {
    if (device_.has_reappeared()) connect_now();
    if (!may_connect(now_ns)) return;
    const auto identity = device_.connect();
    note_connected(words({identity.model, identity.serial, identity.firmware}), identity.sample_rate_hz);
    next_sync_ns_ = now_ns;
    last_command_ = ~std::uint64_t{0};
    report_health(now_ns, link_.health, true);
  }

  const std::uint32_t beat = link_.loop_beat.load(std::memory_order_acquire);
  const bool loop_alive = beat != last_beat_;
  // Commands go out when they change, and again before the device's validity time ends; a loop that hangs gets
  // neither commands nor heartbeats through, and the device vents by itself.
  const std::uint64_t packed = link_.command.load(std::memory_order_acquire);
  if (loop_alive && (packed != last_command_ || now_ns >= next_command_ns_)) {
    device_.command(link_.get_command());
    last_command_ = packed;
    next_command_ns_ = now_ns + config_.heartbeat_period_ns;
  }
  if (loop_alive && now_ns >= next_heartbeat_ns_) {
    device_.heartbeat();
    last_beat_ = beat;
    next_heartbeat_ns_ = now_ns + config_.heartbeat_period_ns;
  }
  if (clock_in_doubt()) next_sync_ns_ = std::min(next_sync_ns_, last_sync_ns_ + config_.sync_burst_period_ns);
  if (now_ns >= next_sync_ns_) {
    last_sync_ns_ = now_ns;
    device_.request_time_sync();
    next_sync_ns_ = now_ns + (burst_left_ > 0 ? config_.sync_burst_period_ns : config_.sync_period_ns);
    if (burst_left_ > 0) --burst_left_;
  }

  const auto poll = device_.poll(samples_, exchanges_, wait_ns);
  health_.lost += poll.lost;
  health_.corrupt += poll.corrupt;
  for (const auto& exchange : std::span(exchanges_).first(poll.exchanges)) {
    map_.add(exchange);
    link_.exchanges.push(exchange);
  }
  hand_over(std::span<const pressure::Sample>(samples_).first(poll.samples), link_.samples);
  // A loop that has stalled leaves the queue full: what the device did meanwhile must not be lost with it.
  vented_ = vented_ || poll.state.vented_by_itself;
  auto state = poll.state;
  state.vented_by_itself = vented_;
  if (link_.states.push(state)) vented_ = false;
  check_clock(now_ns);
  note_answer();
}

void PressureService::check_clock(std::int64_t now_ns) {
  interlock::SyncLineEdge seen;
  while (line_.sync_edges.pop(seen)) sync_.line_edge(seen.mono_ns, seen.rising);
  while (const auto edge = device_.take_sync_edge()) {
    const auto device_us = static_cast<double>(edge->device_us);
    sync_.device_edge(device_us, edge->rising, map_.current().map(device_us));
  }
  const auto report = [&](const clock::SyncCheck* check) {
    SyncReport r{.mono_ns = now_ns, .has_check = check != nullptr, .check = {}, .counts = sync_.counts()};
    if (check != nullptr) r.check = *check;
    link_.sync.push(r);
    reported_ = sync_.counts();
  };
  while (const auto check = sync_.next(now_ns)) report(&*check);
  if (sync_.counts() != reported_) report(nullptr);
}

void PressureService::fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  if (note_failure(now_ns, error)) {
    device_.disconnect();
    sync_.forget();
  }
  report_health(now_ns, link_.health, true);
}

void PressureService::shut_down() noexcept {
  try {
    if (health_.connected) device_.command({0, 1000, 0.0F});
  } catch (const std::exception&) {
    // The device's own heartbeat time-out vents.
  }
  device_.disconnect();
  health_.connected = false;
}

void RegulatorService::run_once(std::int64_t now_ns) noexcept {
  try {
    turn(now_ns);
  } catch (const drivers::DeviceError& error) {
    fail(now_ns, error);
  } catch (const std::exception& error) {
    fail(now_ns, drivers::DeviceError(drivers::Fault::kDisconnected, error.what()));
  }
  report_health(now_ns, link_.regulator_health, false);
}

void RegulatorService::turn(std::int64_t now_ns) {
  if (!health_.connected) {
    if (!may_connect(now_ns)) return;
    note_connected(device_.connect(), 0.0);
    report_health(now_ns, link_.regulator_health, true);
    // It exhausts now. A run that counted on it is over, however short the break was.
    if (sent_psi_ >= 0.0F) report_fault(now_ns);
    sent_psi_ = -1.0F;
  }
  const std::uint32_t beat = link_.loop_beat.load(std::memory_order_acquire);
  if (beat != last_beat_) {
    last_beat_ = beat;
    last_beat_ns_ = now_ns;
  }
  const auto command = link_.get_command();
  const bool regulate =
      now_ns - last_beat_ns_ < kLoopDeadNs && command.vent_permille == 0 && command.regulator_psi > 0.0F;
  if (!regulate) {
    if (sent_psi_ >= 0.0F) device_.exhaust();
    sent_psi_ = -1.0F;
  } else if (sent_psi_ < 0.0F || std::abs(command.regulator_psi - sent_psi_) >= kSetpointStepPsi) {
    device_.regulate(command.regulator_psi);
    sent_psi_ = command.regulator_psi;
  }
  const auto state = device_.read();
  if (sent_psi_ >= 0.0F && (state.exhausting || std::abs(state.setpoint_psi - sent_psi_) > kSetpointLostPsi)) {
    report_fault(now_ns);
    device_.exhaust();
    throw drivers::DeviceError(drivers::Fault::kRefused,
                               "the regulator no longer has the set-point it was given; is somebody "
                               "at its panel, or was it without power?");
  }
  link_.regulator_reports.push({state, now_ns});
  note_answer();
}

void RegulatorService::report_fault(std::int64_t now_ns) noexcept {
  pressure::RegulatorState lost;
  lost.faulty = true;
  link_.regulator_reports.push({lost, now_ns});
}

void RegulatorService::fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  if (note_failure(now_ns, error)) {
    try {
      device_.exhaust();
    } catch (const std::exception&) {
      // Supply and vent valve are the Teensy's: the pressure goes without it.
    }
    device_.disconnect();
  }
  report_health(now_ns, link_.regulator_health, true);
}

void RegulatorService::shut_down() noexcept {
  try {
    if (health_.connected) device_.exhaust();
  } catch (const std::exception&) {
  }
  device_.disconnect();
  health_.connected = false;
}

void InterlockService::run_once(std::int64_t now_ns) noexcept {
  try {
    turn(now_ns);
  } catch (const std::exception& error) {
    // An input that cannot be read is an open one, and the valve fails to vent.
    device_.disconnect();
    connected_ = false;
    next_attempt_ns_ = now_ns + kInterlockRetryNs;
    link_.set_state({.mono_ns = now_ns, .lost = true});
    ++health_.errors;
    health_.failed_ns = now_ns;
    copy_text(health_.detail, error.what());
    report_health(now_ns, true);
  }
  report_health(now_ns, false);
}

void InterlockService::turn(std::int64_t now_ns) {
  if (!connected_) {
    if (now_ns < next_attempt_ns_) return;
    device_.connect();
    connected_ = true;
    if (was_connected_) ++health_.reconnects;
    was_connected_ = true;
    holding_ = false;
    device_.hold_pressure(false);
    report_health(now_ns, true);
  }
  auto state = device_.read();
  std::array<interlock::SyncLineEdge, 32> edges;
  for (const auto& edge : std::span(edges).first(device_.take_sync_edges(edges))) link_.sync_edges.push(edge);
  state.mono_ns = now_ns;
  link_.set_state(state);
  const std::uint32_t beat = link_.loop_beat.load(std::memory_order_acquire);
  if (beat != last_beat_) {
    last_beat_ = beat;
    last_beat_ns_ = now_ns;
  }
  const bool hold = link_.hold_pressure.load(std::memory_order_acquire) && now_ns - last_beat_ns_ < kLoopDeadNs;
  if (hold != holding_) {
    device_.hold_pressure(hold);
    holding_ = hold;
  }
}

bool InterlockService::wait(std::int64_t timeout_ns) noexcept {
  try {
    return connected_ && device_.wait(timeout_ns);
  } catch (const std::exception&) {
    return true;  // the next turn meets it again and says so
  }
}

void InterlockService::report_health(std::int64_t now_ns, bool force) noexcept {
  if (!force && now_ns < next_health_ns_) return;
  next_health_ns_ = now_ns + kHealthPeriodNs;
  health_.connected = connected_;
  health_.lost = device_.counters().lost_edges;
  link_.health.push(health_);
}

void InterlockService::shut_down() noexcept {
  try {
    if (connected_) device_.hold_pressure(false);
  } catch (const std::exception&) {
  }
  device_.disconnect();
  connected_ = false;
}

}  // namespace isorig::daemon
