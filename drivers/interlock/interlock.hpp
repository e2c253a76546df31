#pragma once
#include <cstdint>

#include "drivers/error.hpp"

/// Emergency-stop chain and guard as inputs, the dump valve as an output. The chain is hard-wired; the daemon
/// only watches it. Implementations: sim/interlock/ now, libgpiod with the hardware.
namespace isorig::interlock {

struct State {
  bool estop_closed = false;   ///< true: the chain is whole, motion is allowed
  bool guard_closed = false;
  std::int64_t mono_ns = 0;    ///< when it was read
};

class Device {
 public:
  virtual ~Device() = default;
  virtual void connect() = 0;
  virtual void disconnect() noexcept = 0;
  virtual State read() = 0;
  /// The dump valve is normally open to exhaust: true energises it (pressure can be held), false vents.
  virtual void hold_pressure(bool energise) = 0;
};

}  // namespace isorig::interlock
