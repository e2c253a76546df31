#pragma once
#include <string>

namespace isorig::daemon {

/// That no other program of this machine drives a device: two daemons on one frame would both command it, and each
/// would feed the watchdog that is there to notice the other's death. A gateway takes several connections, so the
/// claim is kept here: as the name of an abstract Unix socket, which the kernel gives back however the process ends.
/// It reaches as far as the network namespace. Any user of the machine can take such a name; the message then says
/// which process and whose it is, as the kernel knows them.
class DeviceClaim {
 public:
  /// `device` as messages name it ("frame at tcp 127.0.0.1:502"). Throws std::runtime_error that says what to do.
  explicit DeviceClaim(const std::string& device);
  ~DeviceClaim();
  DeviceClaim(DeviceClaim&& other) noexcept;
  DeviceClaim& operator=(DeviceClaim&&) = delete;
  DeviceClaim(const DeviceClaim&) = delete;
  DeviceClaim& operator=(const DeviceClaim&) = delete;

 private:
  int fd_ = -1;
};

}  // namespace isorig::daemon
