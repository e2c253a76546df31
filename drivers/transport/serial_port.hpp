#pragma once
#include <string>

namespace isorig::drivers {

struct SerialSettings {
  std::string tty;
  int baud = 9600;
  char parity = 'N';  ///< 'N', 'E', 'O'
  int data_bits = 8;
  int stop_bits = 1;
};

/// A raw serial line that nobody else has, not blocking. Throws DeviceError: kDisconnected when it is not there or held
/// by another program, kRefused without the rights; `name` begins what it says.
[[nodiscard]] int open_serial(const SerialSettings& settings, const std::string& name);
/// Lets what was written go out, at most 0.1 s: a stop may be the last of it.
void close_serial(int fd) noexcept;

}  // namespace isorig::drivers
