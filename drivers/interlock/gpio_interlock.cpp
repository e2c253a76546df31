#include "drivers/interlock/gpio_interlock.hpp"

#include <time.h>

#include <algorithm>
#include <utility>

namespace isorig::interlock {
namespace {

std::int64_t realtime_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

}  // namespace

GpioInterlock::GpioInterlock(Options options, const clock::Clock& clock, GpioOpener opener)
    : options_(std::move(options)),
      clock_(clock),
      opener_(std::move(opener)),
      estop_(options_.closing_ns),
      guard_(options_.closing_ns) {
  sync_edges_.reserve(kMaxSyncEdges);
}

void GpioInterlock::connect() {
  disconnect();
  GpioRequest request{options_.chip, options_.consumer, {options_.estop}, options_.vent_valve};
  const auto add = [&](const std::optional<GpioLine>& line, std::size_t& input) {
    if (!line) return;
    input = request.inputs.size();
    request.inputs.push_back(*line);
  };
  add(options_.guard, guard_input_);
  add(options_.sync, sync_input_);
  port_ = opener_(request);
  estop_.restart();
  guard_.restart();
  stamps_ = {};
}

void GpioInterlock::disconnect() noexcept {
  port_.reset();
  sync_edges_.clear();
}

GpioPort& GpioInterlock::port() {
  if (!port_) {
    throw drivers::DeviceError(drivers::Fault::kDisconnected, "GPIO chip \"" + options_.chip + "\": not connected");
  }
  return *port_;
}

State GpioInterlock::read() {
  GpioPort& lines = port();
  for (int i = 0; i < kMaxReads; ++i) {
    const GpioEdges taken = lines.read_edges(edges_);
    const std::int64_t now_ns = clock_.now_ns();
    for (std::size_t e = 0; e < taken.count; ++e) take(edges_[e], now_ns);
    counters_.lost_edges += taken.lost;
    if (taken.count == 0) break;
  }
  follow_level(kEstop, estop_);
  if (options_.guard) follow_level(guard_input_, guard_);
  const std::int64_t now_ns = clock_.now_ns();
  return {.estop_closed = estop_.closed(now_ns),
          .guard_closed = !options_.guard || guard_.closed(now_ns),
          .mono_ns = now_ns,
          .estop_opened_ns = estop_.opened_ns(),
          .guard_opened_ns = guard_.opened_ns()};
}

void GpioInterlock::take(const GpioEdge& edge, std::int64_t now_ns) {
  ++counters_.edges;
  const auto stamp = stamps_.to_mono(edge.stamp_ns, now_ns, realtime_ns());
  if (sync_input_ != 0 && edge.input == sync_input_) {
    // Stamped on arrival it would measure this thread, not the device's clock.
    if (stamp && sync_edges_.size() < kMaxSyncEdges) sync_edges_.push_back({*stamp, edge.active});
    return;
  }
  Contact& contact = edge.input == kEstop ? estop_ : guard_;
  contact.edge(edge.active, std::min(stamp.value_or(now_ns), now_ns));
}

void GpioInterlock::follow_level(std::size_t input, Contact& contact) {
  if (contact.level(port_->level(input), clock_.now_ns())) ++counters_.resynchronised;
}

void GpioInterlock::hold_pressure(bool energise) {
  if (options_.vent_valve) port().set_output(energise);
}

bool GpioInterlock::wait(std::int64_t timeout_ns) {
  if (!port_) return false;
  port_->wait(timeout_ns);
  return true;
}

std::size_t GpioInterlock::take_sync_edges(std::span<SyncLineEdge> out) {
  const std::size_t count = std::min(out.size(), sync_edges_.size());
  std::copy_n(sync_edges_.begin(), count, out.begin());
  sync_edges_.erase(sync_edges_.begin(), sync_edges_.begin() + static_cast<std::ptrdiff_t>(count));
  return count;
}

}  // namespace isorig::interlock
