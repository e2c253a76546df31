#pragma once
#include <atomic>

#include "drivers/interlock/interlock.hpp"
#include "sim/host.hpp"

namespace isorig::sim {

/// E-stop chain, guard and dump valve. As hard-wired on a rig: an open e-stop disables the drive and
/// de-energises the dump valve, whatever the daemon asks for; an open guard disables the drive only.
class SimInterlock final : public interlock::Device {
 public:
  explicit SimInterlock(Host& host) noexcept : host_(host) {}

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

  [[nodiscard]] bool drive_enabled() const noexcept {
    return estop_closed.load(std::memory_order_relaxed) && guard_closed.load(std::memory_order_relaxed);
  }
  [[nodiscard]] double dump_opening() const noexcept {
    return energised_ && estop_closed.load(std::memory_order_relaxed) ? 0.0 : 1.0;
  }

  // Switches for tests and demonstrations; any thread.
  std::atomic<bool> estop_closed{true};
  std::atomic<bool> guard_closed{true};
  std::atomic<bool> faulty{false};  ///< every call throws kDisconnected

 private:
  void require_link() const {
    if (!connected_ || faulty) {
      throw drivers::DeviceError(drivers::Fault::kDisconnected, "simulated interlock: not connected");
    }
  }
  Host& host_;
  bool energised_ = false;
  bool connected_ = false;
};

}  // namespace isorig::sim
