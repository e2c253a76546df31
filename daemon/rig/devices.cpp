#include "daemon/rig/devices.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <variant>

#include "base/overloaded.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "drivers/frame/modbus_frame.hpp"
#include "drivers/interlock/gpio_interlock.hpp"
#include "drivers/pressure/alicat_regulator.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "drivers/pressure/usb_stream.hpp"
#include "sim/interlock/unconnected_interlock.hpp"

namespace isorig::daemon {
namespace {

std::unique_ptr<pressure::ByteStream> open_stream(const RigConfig& rig) {
  if (!rig.teensy->port.empty())
    return std::make_unique<pressure::TtyStream>(pressure::TtyStream::Options{rig.teensy->port});
  pressure::UsbStream::Options options;
  options.serial = rig.teensy->options.serial;
  // Above the thread that reads, so that a packet is stamped when it comes; below the loop.
  if (rig.realtime.enforce) options.event_priority = std::min(rig.realtime.io_priority + 1, rig.realtime.priority - 1);
  return std::make_unique<pressure::UsbStream>(options);
}

struct NamedFrame {
  std::unique_ptr<frame::Device> device;
  std::string where;
};

NamedFrame open_frame(const RigConfig& rig, clock::Clock& clock) {
  return std::visit(
      base::Overloaded{[](const RigConfig::SimulatedFrame&) -> NamedFrame {
                         throw std::logic_error("a simulated frame has no driver");
                       },
                       [&](const modbus::ModbusConfig& c) {
                         return NamedFrame{std::make_unique<frame::ModbusFrame>(c, clock), c.where()};
                       },
                       [&](const frame::Instron8800Config& c) {
                         return NamedFrame{std::make_unique<frame::Instron8800Frame>(c, clock), c.where()};
                       }},
      rig.frame);
}

}  // namespace

Devices open_devices(const RigConfig& rig, clock::Clock& clock) {
  Devices d;
  if (rig.simulated()) {
    sim::RigOptions options;
    options.start_ns = clock.now_ns();
    options.clock = &clock;
    options.threaded = true;
    d.rig = std::make_unique<sim::Rig>(*rig.sim, sim::load_specimen(rig.sim->specimen), options);
    d.frame = &d.rig->frame();
    d.pressure = &d.rig->pressure();
    d.interlock = &d.rig->interlock();
    return d;
  }
  auto frame = open_frame(rig, clock);
  d.claims.emplace_back("frame at " + frame.where);
  d.claims.emplace_back("pressure device at " + rig.teensy->where());
  d.owned_frame = std::move(frame.device);
  d.owned_pressure = std::make_unique<pressure::Teensy>(rig.teensy->options, open_stream(rig), clock);
  if (rig.gpio) {
    d.owned_interlock = std::make_unique<interlock::GpioInterlock>(*rig.gpio, clock);
  } else {
    d.owned_interlock = std::make_unique<sim::UnconnectedInterlock>();
  }
  if (rig.regulator) {
    d.claims.emplace_back("pressure regulator at " + rig.regulator->line.where());
    d.regulator = std::make_unique<pressure::AlicatRegulator>(*rig.regulator);
  }
  d.frame = d.owned_frame.get();
  d.pressure = d.owned_pressure.get();
  d.interlock = d.owned_interlock.get();
  return d;
}

}  // namespace isorig::daemon
