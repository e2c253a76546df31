#include "drivers/pressure/usb_devices.hpp"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <optional>
#include <system_error>

#include "base/formatted.hpp"
#include "drivers/api/error.hpp"

namespace isorig::pressure {
namespace {

namespace fs = std::filesystem;
using drivers::DeviceError;
using drivers::Fault;

constexpr std::uint16_t kPjrc = 0x16c0;
/// Where the package isorig-tools puts it.
const std::string kFirmware = "/usr/share/isorig/firmware/isorig-teensy36.hex";
constexpr std::uint32_t kLeastUnscaledSerial = 10'000'000;

std::string line_of(const fs::path& file) {
  std::string line;
  std::ifstream in(file);
  std::getline(in, line);
  return line;
}

/// Of a folder that may vanish while it is read.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    entries.push_back(at->path());
  return entries;
}

template <class Number>
std::optional<Number> number(const std::string& text, int base) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc{} || text.empty() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

UsbKind kind_of(std::uint16_t vendor, std::uint16_t product) {
  // Others share 16c0, but not its 04xx: PJRC's own udev rules match that too.
  if (vendor != kPjrc || product >> 8U != 0x04) return UsbKind::kOther;
  switch (product) {
    case 0x0483:
      return UsbKind::kTeensy;
    case 0x0478:
      return UsbKind::kBootloader;
    case 0x0477:
      return UsbKind::kRebootor;
    default:
      return UsbKind::kOtherPjrc;
  }
}

std::string ids_of(const UsbDevice& device) {
  return base::formatted("%04x:%04x", device.vendor_id, device.product_id);
}

/// The boot loader shows the number of the fuses in hexadecimal and does not multiply it.
std::string serial_under_program(const UsbDevice& device) {
  if (device.kind != UsbKind::kBootloader) return device.serial;
  const auto fuses = number<std::uint32_t>(device.serial, 16);
  return fuses ? teensy_serial(*fuses) : device.serial;
}

void read_interface(const fs::path& interface, UsbDevice& device) {
  std::error_code error;
  const fs::path driver = fs::read_symlink(interface / "driver", error);
  if (!error && driver.filename() == "usbfs") device.is_claimed = true;
  for (const auto& folder : {interface / "tty", interface}) {  // of cdc_acm, of usb-serial
    for (const auto& entry : entries_of(folder)) {
      const std::string name = entry.filename();
      if (device.tty.empty() && name.starts_with("tty") && name != "tty") device.tty = "/dev/" + name;
    }
  }
}

std::optional<UsbDevice> read_device(const fs::path& folder) {
  const auto vendor = number<std::uint16_t>(line_of(folder / "idVendor"), 16);
  const auto product = number<std::uint16_t>(line_of(folder / "idProduct"), 16);
  const auto bus = number<unsigned>(line_of(folder / "busnum"), 10);
  const auto address = number<unsigned>(line_of(folder / "devnum"), 10);
  if (!vendor || !product || !bus || !address) return std::nullopt;  // an interface, or gone meanwhile
  UsbDevice device;
  device.name = folder.filename();
  device.node = base::formatted("/dev/bus/usb/%03u/%03u", *bus, *address);
  device.vendor_id = *vendor;
  device.product_id = *product;
  device.kind = kind_of(*vendor, *product);
  device.serial = line_of(folder / "serial");
  device.manufacturer = line_of(folder / "manufacturer");
  device.product = line_of(folder / "product");
  for (const auto& entry : entries_of(folder)) {
    if (entry.filename().string().starts_with(device.name + ":")) read_interface(entry, device);
  }
  if (device.kind == UsbKind::kOther && device.tty.empty()) return std::nullopt;
  device.is_accessible = ::access(device.node.c_str(), R_OK | W_OK) == 0;
  return device;
}

std::string list(const std::vector<UsbDevice>& devices) {
  std::string text;
  for (const auto& device : devices) text += (text.empty() ? "" : "; ") + describe(device);
  return text;
}

[[noreturn]] void fail_absent(const std::string& serial, const std::vector<UsbDevice>& devices) {
  const std::string wanted = serial.empty() ? "no Teensy" : "no Teensy with serial number " + serial;
  // Whatever answers to the serial number, in another guise.
  for (const auto& device : devices) {
    if (!serial.empty() && serial_under_program(device) != serial) continue;
    if (device.kind == UsbKind::kBootloader)
      throw DeviceError(Fault::kDisconnected, describe(device) + ": " + problem_of(device));
    if (device.kind == UsbKind::kOtherPjrc || (device.kind == UsbKind::kOther && !serial.empty()))
      throw DeviceError(Fault::kIdentity, describe(device) + ": " + problem_of(device));
  }
  if (devices.empty()) {
    throw DeviceError(Fault::kDisconnected, wanted +
                                                " is on USB; is it plugged in, with a cable that carries data, and "
                                                "powered? `isorig devices` lists what is there");
  }
  const auto scaled = number<std::uint32_t>(serial, 10);
  const bool wants_scaled =
      scaled && std::ranges::any_of(devices, [&](const UsbDevice& d) {
        return d.kind == UsbKind::kTeensy && d.serial != serial && d.serial == teensy_serial(*scaled);
      });
  throw DeviceError(Fault::kIdentity,
                    wanted + " is on USB; there is: " + list(devices) +
                        (wants_scaled ? ". A Teensy shows small serial numbers times ten: write serial = \"" +
                                            teensy_serial(*scaled) + "\""
                                      : ". Plug in the right one, or put its serial number into the rig's file"));
}

}  // namespace

std::string teensy_serial(std::uint32_t fuses) {
  const std::uint64_t shown = fuses < kLeastUnscaledSerial ? std::uint64_t{fuses} * 10 : fuses;
  return std::to_string(shown);
}

std::vector<UsbDevice> list_usb_devices(const fs::path& sys) {
  std::vector<UsbDevice> devices;
  for (const auto& entry : entries_of(sys / "bus/usb/devices")) {
    if (auto device = read_device(entry)) devices.push_back(std::move(*device));
  }
  std::ranges::sort(devices, {}, &UsbDevice::name);
  return devices;
}

std::string describe(const UsbDevice& device) {
  std::string text = ids_of(device);
  if (!device.product.empty()) text += " " + device.product;
  text += device.serial.empty() ? " without a serial number" : " serial " + device.serial;
  text += " at " + device.name;
  if (!device.tty.empty()) text += " (" + device.tty + ")";
  return text;
}

std::string problem_of(const UsbDevice& device) {
  switch (device.kind) {
    case UsbKind::kBootloader:
      return "is in its boot loader (HalfKay) and runs no program; flash " + kFirmware +
             " (README beside it), or pull the plug and put it in again";
    case UsbKind::kRebootor:
      return "is a rebootor, which resets another Teensy; it is not the rig's";
    case UsbKind::kOtherPjrc:
      return "is a Teensy with another program (USB type " + ids_of(device).substr(5) +
             " is no plain serial port); flash " + kFirmware + " (README beside it)";
    case UsbKind::kOther:
      return "is no Teensy; the rig's pressure device is a Teensy at 16c0:0483";
    case UsbKind::kTeensy:
      break;
  }
  if (device.is_claimed) {
    const std::string who = programs_with_open(device.node);
    return "another program holds it" + (who.empty() ? "" : ": " + who) + "; stop it first (`fuser -v " +
           device.node.string() + "` names it)";
  }
  if (!device.is_accessible) {
    return "no permission for " + device.node.string() +
           "; the rule /usr/lib/udev/rules.d/60-isorig.rules gives it to the group isorig: install it, run "
           "`udevadm control --reload`, plug the device in again, and run as a member of that group";
  }
  const std::string who = device.tty.empty() ? "" : programs_with_open(device.tty);
  if (!who.empty()) return "another program has its port " + device.tty + " open: " + who + "; stop it first";
  return {};
}

UsbDevice find_teensy(const std::string& serial, const std::vector<UsbDevice>& devices) {
  std::vector<UsbDevice> found;
  for (const auto& device : devices) {
    if (device.kind == UsbKind::kTeensy && (serial.empty() || device.serial == serial)) found.push_back(device);
  }
  if (found.empty()) fail_absent(serial, devices);
  if (found.size() > 1) {
    throw DeviceError(Fault::kIdentity, "several Teensys are on USB: " + list(found) +
                                            (serial.empty() ? ". Put the serial number of the rig's into its file"
                                                            : ". They have the same serial number: unplug one"));
  }
  const std::string problem = problem_of(found.front());
  if (!problem.empty()) {
    const bool is_right = !found.front().is_claimed && !found.front().is_accessible;
    throw DeviceError(is_right ? Fault::kRefused : Fault::kDisconnected, describe(found.front()) + ": " + problem);
  }
  return found.front();
}

std::string programs_with_open(const fs::path& file) {
  std::string found;
  for (const auto& process : entries_of("/proc")) {
    const std::string pid = process.filename();
    if (!number<unsigned>(pid, 10) || pid == std::to_string(::getpid())) continue;
    for (const auto& fd : entries_of(process / "fd")) {
      std::error_code unreadable;
      if (fs::read_symlink(fd, unreadable) != file) continue;
      found += (found.empty() ? "" : ", ") + line_of(process / "comm") + " (pid " + pid + ")";
      break;
    }
  }
  return found;
}

}  // namespace isorig::pressure
