#pragma once
#include <cstdint>
#include <string>

#include "drivers/api/error.hpp"

/// A pressure regulator: it closes its own loop round its own sensor. What counts is still what the ELVH measures.
namespace isorig::pressure {

struct RegulatorState {
  float setpoint_psi = 0.0F;  ///< as the regulator has it
  float pressure_psi = 0.0F;  ///< of its own sensor
  bool exhausting = false;
  bool faulty = false;  ///< its own sensor or converter is out of order
};

/// Owned by one I/O thread; throws drivers::DeviceError. Not for the real-time loop.
class Regulator {
 public:
  virtual ~Regulator() = default;
  /// Connects, checks that numbers mean what they should, and leaves the regulator exhausting. Returns what it is.
  virtual std::string connect() = 0;
  virtual void disconnect() noexcept = 0;
  /// Written and read back; kRefused when the regulator makes something else of it. Ends an exhaust.
  virtual void regulate(float setpoint_psi) = 0;
  /// Set-point 0, and the exhaust valve open.
  virtual void exhaust() = 0;
  virtual RegulatorState read() = 0;
};

}  // namespace isorig::pressure
