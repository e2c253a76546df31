#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace isorig::pressure {

/// What a device on the bus is, as its VID:PID says (Teensy cores, usb_desc.h).
enum class UsbKind {
  kTeensy,      ///< 16c0:0483, a Teensy whose program is a serial port
  kBootloader,  ///< 16c0:0478, HalfKay: a Teensy that waits for a program
  kRebootor,    ///< 16c0:0477, a Teensy that resets another one for the loader
  kOtherPjrc,   ///< 16c0:04xx, a Teensy whose program is no plain serial port
  kOther,       ///< any other device with a serial port
};

struct UsbDevice {
  std::string name;            ///< the kernel's: bus, then ports ("1-1.2")
  std::filesystem::path node;  ///< /dev/bus/usb/001/004
  std::string tty;             ///< /dev/ttyACM0; empty without one
  std::uint16_t vendor_id = 0, product_id = 0;
  std::string serial, manufacturer, product;
  UsbKind kind = UsbKind::kOther;
  bool is_accessible = false;  ///< this process may open `node` for writing
  bool is_claimed = false;     ///< a program holds an interface of it over usbfs
};

/// The serial number that a Teensy shows on USB for the number in its fuses. Below 10 000 000 it is that number times
/// ten, which works around a fault of an old macOS driver (Teensy cores, usb_desc.c).
[[nodiscard]] std::string teensy_serial(std::uint32_t fuses);

/// Every Teensy on the bus in whatever state, and every other device with a serial port. Reads sysfs, so it opens no
/// device, needs no rights and no udev. `sys` is another root for tests.
[[nodiscard]] std::vector<UsbDevice> list_usb_devices(const std::filesystem::path& sys = "/sys");

/// One line: "16c0:0483 serial 1234560 at 1-1.2 (/dev/ttyACM0)".
[[nodiscard]] std::string describe(const UsbDevice& device);

/// What keeps the driver from using it, with what to do; empty when nothing does.
[[nodiscard]] std::string problem_of(const UsbDevice& device);

/// The Teensy with that serial number, or the only one when it is empty, ready to be opened. Throws DeviceError:
/// kDisconnected absent, in its boot loader, or held by another program; kIdentity another device, another program, or
/// several to choose from; kRefused without permission. The message says what to do.
[[nodiscard]] UsbDevice find_teensy(const std::string& serial, const std::vector<UsbDevice>& devices);

/// "minicom (pid 1234)" of the programs that have `file` open, as far as this process may know; else empty.
[[nodiscard]] std::string programs_with_open(const std::filesystem::path& file);

}  // namespace isorig::pressure
