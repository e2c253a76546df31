#include "sim/wire/pressure/teensy_descriptors.hpp"

#include <array>
#include <cstdio>
#include <cstdlib>

namespace isorig::sim {
namespace {

// Of the serial type; what cdc_acm and drivers/pressure/usb_session.cpp look for.
constexpr std::array<std::uint8_t, 67> kSerialConfiguration = {
    9, 2,    67,   0,    2,  1,    0,  0xC0, 50,  // configuration, 100 mA
    9, 4,    0,    0,    1,  2,    2,  1,    0,   // interface 0: communication
    5, 0x24, 0,    0x10, 1,                       // CDC 1.1
    5, 0x24, 1,    1,    1,                       // call management
    4, 0x24, 2,    6,                             // line coding and state
    5, 0x24, 6,    0,    1,                       // union
    7, 5,    0x82, 3,    16, 0,    64,            // interrupt IN
    9, 4,    1,    0,    2,  0x0A, 0,  0,    0,   // interface 1: data
    7, 5,    0x03, 2,    64, 0,    0,             // bulk OUT
    7, 5,    0x84, 2,    64, 0,    0};            // bulk IN
constexpr std::array<std::uint8_t, 27> kBootloaderConfiguration = {
    9, 2,    27,   0, 1, 1, 0,    0xC0, 50,  // configuration
    9, 4,    0,    0, 0, 3, 0,    0,    0,   // a human interface device without endpoints
    9, 0x21, 0x11, 1, 0, 1, 0x22, 21,   0};

}  // namespace

bool get_descriptor(const TeensyIdentity& of, std::uint16_t value, std::vector<std::uint8_t>& out) {
  const auto low = [](unsigned v) { return static_cast<std::uint8_t>(v); };
  const std::uint16_t product_id = of.is_bootloader ? 0x0478 : of.port.product_id;
  switch (value >> 8U) {
    case 1:
      out = {18,
             1,
             0x10,
             1,
             low(of.is_bootloader ? 0 : 2),
             0,
             0,
             64,
             low(of.port.vendor_id),
             low(of.port.vendor_id >> 8U),
             low(product_id),
             low(product_id >> 8U),
             0x80,
             2,
             1,
             2,
             3,
             1};
      return true;
    case 2:
      if (of.is_bootloader) {
        out.assign(kBootloaderConfiguration.begin(), kBootloaderConfiguration.end());
      } else {
        out.assign(kSerialConfiguration.begin(), kSerialConfiguration.end());
      }
      return true;
    case 3:
      break;
    default:
      return false;  // no device qualifier: full speed only
  }
  std::string text;
  switch (value & 0xFFU) {
    case 0:
      out = {4, 3, 9, 4};
      return true;
    case 1:
      text = "Teensyduino";
      break;
    case 2:
      text = of.is_bootloader ? "HalfKay" : of.port.product;
      break;
    case 3:
      text = of.serial;
      break;
    default:
      return false;
  }
  if (of.is_bootloader && (value & 0xFFU) == 3) {
    std::array<char, 24> fuses{};
    std::snprintf(fuses.data(), fuses.size(), "%08lX", std::strtoul(text.c_str(), nullptr, 10) / 10);
    text = fuses.data();
  }
  out = {low(static_cast<unsigned>(2 + 2 * text.size())), 3};
  for (const char c : text) {
    out.push_back(static_cast<std::uint8_t>(c));
    out.push_back(0);
  }
  return true;
}

}  // namespace isorig::sim
