#pragma once
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/api/error.hpp"

/// Emergency-stop chain and guard as inputs, the dump valve as an output. The chain is hard-wired; the daemon
/// only watches it. Implementations: sim/interlock/, drivers/interlock/gpio_interlock.hpp (libgpiod).
namespace isorig::interlock {

struct State {
  bool estop_closed = false;  ///< true: the chain is whole, motion is allowed
  bool guard_closed = false;
  std::int64_t mono_ns = 0;  ///< when it was read
  /// When each last opened, as the kernel stamped it; 0: not known. An opening that was over before this was read is
  /// seen by it alone.
  std::int64_t estop_opened_ns = 0;
  std::int64_t guard_opened_ns = 0;
  bool lost = false;  ///< the inputs cannot be read, so nothing is known to be closed
};

/// An edge of the sync line, which the pressure device raises at a known time of its own clock.
struct SyncLineEdge {
  std::int64_t mono_ns = 0;  ///< the kernel's stamp
  bool rising = false;
};

/// Since construction.
struct Counters {
  std::uint32_t edges = 0;           ///< of all inputs
  std::uint32_t lost_edges = 0;      ///< as far as they can be counted
  std::uint32_t resynchronised = 0;  ///< inputs whose level was another than their last edge said
};

class Device {
 public:
  virtual ~Device() = default;
  virtual void connect() = 0;
  virtual void disconnect() noexcept = 0;
  virtual State read() = 0;
  /// The dump valve is normally open to exhaust: true energises it (pressure can be held), false vents.
  virtual void hold_pressure(bool energise) = 0;
  /// Waits for an input to change, at most `timeout_ns`. False at once when the device cannot tell.
  virtual bool wait(std::int64_t /*timeout_ns*/) { return false; }
  /// Edges of the sync line seen by the last read(), oldest first.
  virtual std::size_t take_sync_edges(std::span<SyncLineEdge> /*out*/) { return 0; }
  [[nodiscard]] virtual Counters counters() const noexcept { return {}; }
};

}  // namespace isorig::interlock
