#pragma once
#include <cstdint>
#include <string>

#include "drivers/api/clock.hpp"
#include "sim/sync_line.hpp"
#include "sim/wire/wire_rig.hpp"

namespace isorig::sim {

/// The rig's ends of two GPIO lines on a machine with the kernel's gpio-sim (docs/virtual-bench.md): it raises the
/// sync line as the Teensy would, and its dump valve follows what the daemon puts on the vent line.
class GpioLines {
 public:
  struct Options {
    std::string sync_pull;   ///< .../sim_gpioN/pull of the daemon's input; empty: no sync line
    std::string vent_value;  ///< .../sim_gpioN/value of the daemon's output; empty: the valve is held
  };

  GpioLines(Options options, WireRig& rig, const clock::Clock& clock);

  /// At 1 kHz or more, from the thread that serves the rig.
  void service();

 private:
  static constexpr std::int64_t kValvePeriod_ns = 5'000'000;
  static constexpr std::int64_t kEdgeKnown_ns = 300'000;  ///< an emulated edge that took longer is not announced

  Options options_;
  WireRig& rig_;
  const clock::Clock& clock_;
  SyncLineTimes edges_;
  std::int64_t next_valve_ns_ = 0;
};

}  // namespace isorig::sim
