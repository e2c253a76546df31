#include "daemon/io/interlock_service.hpp"

#include <array>
#include <exception>
#include <span>

namespace isorig::daemon {

void InterlockService::run_once(std::int64_t now_ns) noexcept {
  keep(now_ns, [&] { turn(now_ns); });
}

void InterlockService::turn(std::int64_t now_ns) {
  if (!health_.connected) {
    if (!may_connect(now_ns)) return;
    device_.connect();
    note_connected({});
    holding_ = false;
    device_.hold_pressure(false);
    report_health(now_ns, true);
  }
  auto state = device_.read();
  std::array<interlock::SyncLineEdge, 32> edges;
  for (const auto& edge : std::span(edges).first(device_.take_sync_edges(edges))) link_.sync_edges.push(edge);
  state.mono_ns = now_ns;
  link_.set_state(state);
  const bool loop_alive = loop_.alive(link_.loop_beat.load(std::memory_order_acquire), now_ns);
  const bool hold = loop_alive && link_.hold_pressure.load(std::memory_order_acquire);
  if (hold != holding_) {
    device_.hold_pressure(hold);
    holding_ = hold;
  }
}

// An input that cannot be read is an open one, and the valve fails to vent.
void InterlockService::drop(std::int64_t now_ns) noexcept {
  device_.disconnect();
  link_.set_state({.mono_ns = now_ns, .lost = true});
}

void InterlockService::complete(LinkHealth& health) const noexcept {
  health.lost = device_.counters().lost_edges;
}

bool InterlockService::wait(std::int64_t timeout_ns) noexcept {
  try {
    return health_.connected && device_.wait(timeout_ns);
  } catch (const std::exception&) {
    return true;  // the next turn meets it again and says so
  }
}

void InterlockService::shut_down() noexcept {
  try {
    if (health_.connected) device_.hold_pressure(false);
  } catch (const std::exception&) {
  }
  device_.disconnect();
  health_.connected = false;
}

}  // namespace isorig::daemon
