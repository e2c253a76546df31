#include "daemon/services.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <span>

#include "daemon/fixed_text.hpp"

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

// Fewer leave the first stamps with a scatter of a whole round trip.
constexpr std::uint64_t kExchangesForReady = 20;

// A refusal leaves the connection good. A missing or spoilt answer is cleared up by the driver, which lets no late
// reply through; only when they repeat is the connection started afresh, since that stops the frame.
bool loses_connection(drivers::Fault fault, int failures_in_a_row) {
  switch (fault) {
    case drivers::Fault::kRefused: return false;
    case drivers::Fault::kTimeout:
    case drivers::Fault::kProtocol: return failures_in_a_row >= 5;
    case drivers::Fault::kDisconnected:
    case drivers::Fault::kIdentity: break;
  }
  return true;
}

std::string words(std::initializer_list<std::string> parts) {
  std::string all;
  for (const auto& part : parts) {
    if (!part.empty()) all += (all.empty() ? "" : ", ") + part;
  }
  return all;
}

}  // namespace

void LinkKeeper::note_connected(const std::string& identity, double sample_rate_hz) noexcept {
  copy_text(health_.identity, identity);
  health_.sample_rate_hz = static_cast<float>(sample_rate_hz);
  health_.connected = true;
  if (was_connected_) ++health_.reconnects;
  was_connected_ = true;
  backoff_.reset();
  failures_in_a_row_ = 0;
  burst_left_ = config_.sync_burst;
}

bool LinkKeeper::note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  ++health_.errors;
  copy_text(health_.detail, error.what());
  // A connect() that fails has to wait for the next try, whatever the reason.
  if (health_.connected && !loses_connection(error.fault(), ++failures_in_a_row_)) return false;
  health_.connected = false;
  failures_in_a_row_ = 0;
  backoff_.failed(now_ns);
  return true;
}

template <typename Sample, typename Queue>
void LinkKeeper::hand_over(std::span<const Sample> samples, Queue& queue) {
  if (!map_.current().known()) return;
  const std::int64_t arrival_ns = clock_.now_ns();
  for (const auto& sample : samples) {
    const auto stamp = mapper_.map(static_cast<double>(sample.device_us), arrival_ns);
    health_.bound_ns = static_cast<float>(stamp.bound_ns);
    health_.repeatability_ns = static_cast<float>(stamp.repeatability_ns);
    if constexpr (requires { sample.bound_us; }) {
      if (sample.bound_us > 0.0F) {
        health_.bound_ns += 1e3F * sample.bound_us;
        // Anywhere within it, as likely as anywhere else.
        health_.repeatability_ns = std::hypot(health_.repeatability_ns, 1e3F * sample.bound_us / std::sqrt(3.0F));
      }
    }
    queue.push({sample, stamp.mono_ns, health_.bound_ns, health_.repeatability_ns});
  }
}

void LinkKeeper::report_health(std::int64_t now_ns, base::SpscQueue<LinkHealth>& to, bool force) noexcept {
  if (!force && now_ns < next_health_ns_) return;
  next_health_ns_ = now_ns + kHealthPeriodNs;
  health_.clock_ready = map_.current().known() && map_.current().exchanges >= kExchangesForReady;
  to.push(health_);
}

void FrameService::run_once(std::int64_t now_ns) noexcept {
  try {
    turn(now_ns);
  } catch (const drivers::DeviceError& error) {
    fail(now_ns, error);
  } catch (const std::exception& error) {
    fail(now_ns, drivers::DeviceError(drivers::Fault::kDisconnected, error.what()));
  }
  report_health(now_ns, link_.health, false);
}

void FrameService::turn(std::int64_t now_ns) {
  if (!health_.connected) {
    FrameCommand stale;  // a command for a frame that was not there must not run when it comes back
    while (link_.commands.pop(stale)) {
    }
    if (!may_connect(now_ns)) return;
    const auto identity = device_.connect();
    device_.stop();
    note_connected(words({identity.maker, identity.model, identity.serial, identity.firmware}), identity.sample_rate_hz);
    next_sync_ns_ = now_ns;
    has_best_ = false;
    report_health(now_ns, link_.health, true);
  }

  FrameCommand command;
  while (link_.commands.pop(command)) {
    if (command.kind == FrameCommand::Kind::kStop) {
      device_.stop();
    } else {
      device_.start_segment(command.segment);
    }
  }

  const std::uint32_t beat = link_.loop_beat.load(std::memory_order_acquire);
  if (now_ns >= next_heartbeat_ns_ && beat != last_beat_) {
    device_.heartbeat(static_cast<std::uint16_t>(beat));
    last_beat_ = beat;
    next_heartbeat_ns_ = now_ns + config_.heartbeat_period_ns;
  }

  const auto poll = device_.poll(samples_);
  health_.lost += poll.lost;
  if (poll.has_exchange) take_exchange(poll.exchange);
  hand_over(std::span<const frame::Sample>(samples_).first(poll.samples), link_.samples);
  link_.reports.push({poll.state, now_ns});
  note_answer();
}

void FrameService::take_exchange(const clock::Exchange& exchange) {
  const auto keep = [&](const clock::Exchange& e) {
    map_.add(e);
    link_.exchanges.push(e);
  };
  if (burst_left_ > 0) {
    --burst_left_;
    keep(exchange);
    next_sync_ns_ = exchange.host_recv_ns + config_.sync_period_ns;
    return;
  }
  const auto round_trip = [](const clock::Exchange& e) { return e.host_recv_ns - e.host_send_ns; };
  if (!has_best_ || round_trip(exchange) < round_trip(best_)) best_ = exchange;
  has_best_ = true;
  if (exchange.host_recv_ns >= next_sync_ns_) {
    keep(best_);
    has_best_ = false;
    next_sync_ns_ = exchange.host_recv_ns + config_.sync_period_ns;
  }
}

void FrameService::fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept {
  if (note_failure(now_ns, error)) device_.disconnect();
  report_health(now_ns, link_.health, true);
}

void FrameService::shut_down() noexcept {
  try {
    if (health_.connected) device_.stop();
  } catch (const std::exception&) {
    // The frame's own heartbeat time-out stops it.
  }
  device_.disconnect();
  health_.connected = false;
}

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
  if (now_ns >= next_sync_ns_) {
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
  link_.states.push(poll.state);
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
  const bool regulate = now_ns - last_beat_ns_ < kLoopDeadNs && command.vent_permille == 0 && command.regulator_psi > 0.0F;
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
    throw drivers::DeviceError(drivers::Fault::kRefused, "the regulator no longer has the set-point it was given; is somebody "
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
