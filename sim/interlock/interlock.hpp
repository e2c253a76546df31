#pragma once
#include <atomic>

#include "drivers/api/interlock.hpp"
#include "sim/host.hpp"
#include "sim/sync_line.hpp"

namespace isorig::sim {

/// E-stop chain, guard and dump valve. As hard-wired on a rig: an open e-stop disables the drive and
/// de-energises the dump valve, whatever the daemon asks for; an open guard disables the drive only.
class SimInterlock final : public interlock::Device {
 public:
  explicit SimInterlock(Host& host, std::int64_t start_ns = 0) noexcept : host_(host), sync_line_(start_ns) {}

  void connect() override { connected_ = true; }
  void disconnect() noexcept override { connected_ = false; }
  interlock::State read() override {
    const auto visit = host_.enter();
    require_link();
    return {estop_closed, guard_closed, visit.now_ns};
  }
  void hold_pressure(bool energise) override {
    const auto visit = host_.enter();
    require_link();
    energised_ = energise;
  }

  std::size_t take_sync_edges(std::span<interlock::SyncLineEdge> out) override {
    const auto visit = host_.enter();
    std::size_t count = 0;
    while (count < out.size() && sync_line_.next(visit.now_ns, out[count].mono_ns, out[count].rising)) ++count;
    return count;
  }

  [[nodiscard]] bool drive_enabled() const noexcept {
    return estop_closed.load(std::memory_order_relaxed) &&
           (guard_closed.load(std::memory_order_relaxed) || !guard_stops_frame.load(std::memory_order_relaxed));
  }
  [[nodiscard]] double dump_opening() const noexcept {
    return energised_ && estop_closed.load(std::memory_order_relaxed) ? 0.0 : 1.0;
  }

  // Switches for tests and demonstrations; any thread.
  std::atomic<bool> estop_closed{true};
  std::atomic<bool> guard_closed{true};
  std::atomic<bool> guard_stops_frame{true};  ///< its contact is in the frame's own chain; else it is watched only
  std::atomic<bool> faulty{false};            ///< every call throws kDisconnected

 private:
  void require_link() const {
    if (!connected_ || faulty) {
      throw drivers::DeviceError(drivers::Fault::kDisconnected, "simulated interlock: not connected");
    }
  }
  Host& host_;
  SyncLineTimes sync_line_;
  bool energised_ = false;
  bool connected_ = false;
};

}  // namespace isorig::sim
