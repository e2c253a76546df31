#include "daemon/io/pressure_service.hpp"

#include <algorithm>
#include <exception>
#include <span>

namespace isorig::daemon {

void PressureService::run_once(std::int64_t now_ns, std::int64_t wait_ns) noexcept {
  keep(now_ns, [&] { turn(now_ns, wait_ns); });
}

void PressureService::turn(std::int64_t now_ns, std::int64_t wait_ns) {
  for (pressure::FillLimits limits; link_.limits.pop(limits);) device_.set_limits(limits);
  if (!health_.connected) {
    if (device_.has_reappeared()) connect_now();
    if (!may_connect(now_ns)) return;
    const auto identity = device_.connect();
    note_connected(words({identity.model, identity.serial, identity.firmware}), identity.sample_rate_hz);
    next_sync_ns_ = now_ns;
    last_command_ = ~std::uint64_t{0};
    report_health(now_ns, true);
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

void PressureService::drop(std::int64_t /*now_ns*/) noexcept {
  device_.disconnect();
  sync_.forget();
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

}  // namespace isorig::daemon
