#include <cstdio>
#include <memory>
#include <string>

#include "cli/command.hpp"
#include "drivers/pressure/usb_devices.hpp"

namespace isorig::cli {
namespace {

int devices() {
  const auto found = pressure::list_usb_devices();
  if (found.empty()) {
    std::fputs(
        "no Teensy and no other device with a serial port is on USB; plug one in, with a cable that carries "
        "data\n",
        stderr);
    return kFailure;
  }
  int usable = 0;
  for (const auto& device : found) {
    const std::string problem = pressure::problem_of(device);
    std::printf("%s: %s\n", pressure::describe(device).c_str(), problem.empty() ? "ready" : problem.c_str());
    if (!problem.empty()) continue;
    ++usable;
    std::printf("  [pressure] driver = \"teensy\", transport = \"usb\", serial = \"%s\"\n", device.serial.c_str());
  }
  return usable > 0 ? kOk : kFailure;
}

Command add_devices(CLI::App& app) {
  auto* sub = app.add_subcommand("devices",
                                 "List the Teensys and serial adapters on USB, and what keeps isorigd from using each");
  return {sub, [] { return devices(); }};
}

const Registration kDevices(10, add_devices);

}  // namespace
}  // namespace isorig::cli
