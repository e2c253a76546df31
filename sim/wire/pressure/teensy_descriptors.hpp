#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace isorig::sim {

struct TeensyPort {
  std::uint16_t vendor_id = 0x16c0;
  std::uint16_t product_id = 0x0483;
  std::string product = "USB Serial";
};

/// What a Teensy on the bus says it is.
struct TeensyIdentity {
  const TeensyPort& port;
  const std::string& serial;
  bool is_bootloader;  ///< HalfKay, which has a product id and a number of its own
};

/// The answer to GET_DESCRIPTOR with this wValue (type in the high byte, index in the low): device, configuration or
/// string, those of the serial type of Teensy 3.6 (Teensy cores, usb_desc.c). False: the device has no such descriptor.
[[nodiscard]] bool get_descriptor(const TeensyIdentity& of, std::uint16_t value, std::vector<std::uint8_t>& out);

}  // namespace isorig::sim
