#pragma once
#include <atomic>

#include "drivers/api/interlock.hpp"

namespace isorig::sim {

/// A chain that is whole and a valve that nobody hears: for a rig whose devices are on the wire while its chain is
/// not connected to this computer. The frame's own chain still acts, and is watched through its fault bits.
class UnconnectedInterlock final : public interlock::Device {
 public:
  void connect() override {}
  void disconnect() noexcept override {}
  interlock::State read() override { return {estop_closed.load(), guard_closed.load(), 0}; }
  void hold_pressure(bool energise) override { energised.store(energise); }

  // Switches for tests; the last word of hold_pressure().
  std::atomic<bool> estop_closed{true};
  std::atomic<bool> guard_closed{true};
  std::atomic<bool> energised{false};
};

}  // namespace isorig::sim
