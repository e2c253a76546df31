#pragma once
#include <stdexcept>
#include <string>

namespace isorig::drivers {

/// What went wrong with a device, as far as the caller has to tell cases apart.
enum class Fault {
  kTimeout,       ///< no answer in time; the same connection may still be good
  kDisconnected,  ///< the connection is gone; reconnect with back-off
  kProtocol,      ///< an answer that is not one (CRC, length, wrong unit, late reply)
  kRefused,       ///< the device understood and said no (Modbus exception, limit, interlock)
  kIdentity,      ///< another device than the configuration names
};

/// Thrown by device calls. Never crosses into the real-time loop: the I/O thread that owns the device
/// catches it, counts it and hands a state on.
class DeviceError : public std::runtime_error {
 public:
  DeviceError(Fault fault, const std::string& what) : std::runtime_error(what), fault_(fault) {}
  [[nodiscard]] Fault fault() const noexcept { return fault_; }

 private:
  Fault fault_;
};

}  // namespace isorig::drivers
