#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include "drivers/api/clock.hpp"
#include "drivers/config/instron8800_config.hpp"
#include "drivers/config/modbus_config.hpp"
#include "drivers/config/regulator_config.hpp"
#include "sim/rig.hpp"
#include "sim/wire/faults.hpp"
#include "sim/wire/frame/instron8800_server.hpp"
#include "sim/wire/frame/modbus_server.hpp"
#include "sim/wire/pressure/emulated_teensy.hpp"
#include "sim/wire/pressure/regulator_server.hpp"

namespace isorig::sim {

/// Where and what an emulated rig serves. read_wire_rig() takes it from the same rig file the daemon runs
/// with: what its [frame] and [pressure] connect to is what is served, by the plant of its [sim].
struct WireRigConfig {
  SimConfig sim;
  struct Modbus {
    modbus::ModbusConfig line;
    std::string rtu_link;  ///< also on a pseudo-terminal, linked from here; empty: not
  };
  struct Instron8800 {
    frame::Instron8800Config line;
    Instron8800Server::Options controller;  ///< what [sim.controller] says
  };
  /// std::visit it with base::Overloaded: another kind of frame is an alternative here and in WireFrame.
  std::variant<Modbus, Instron8800> frame;
  /// When set a regulator sets the pressure, and the Teensy's fill valve is its supply valve.
  std::optional<pressure::RegulatorConfig> regulator;
  std::string teensy_link;  ///< link to the Teensy's pseudo-terminal; empty: the Teensy is on USB (teensy_usbip.hpp)
  std::string teensy_serial = "1234560";
};

/// Throws base::ConfigError with all that is wrong.
[[nodiscard]] WireRigConfig read_wire_rig(const std::filesystem::path& rig_file);

/// The emulated frame on the wire, with its fault switches.
struct WireModbus {
  WireModbus(const WireRigConfig::Modbus& config, Rig& rig);
  FrameWireFaults faults;
  ModbusServer server;
};
struct WireInstron8800 {
  WireInstron8800(const WireRigConfig::Instron8800& config, Rig& rig);
  Instron8800Faults faults;
  Instron8800Server server;
};
using WireFrame = std::variant<std::unique_ptr<WireModbus>, std::unique_ptr<WireInstron8800>>;

/// One simulated rig in real time, with its frame on Modbus or behind an 8800-type controller, and its Teensy on a
/// pseudo-terminal or on USB.
///
/// On the wire the delays are the wire's own: the simulated ones of [sim.frame] and [sim.pressure]
/// (`request`, `reply`, `exchange_interval_ms`) do not apply. The device clocks are those of [sim]; the
/// Teensy's has offset and skew, no wander.
class WireRig {
 public:
  WireRig(const WireRigConfig& config, const clock::Clock& clock, bool keep_truth = false);

  /// Serves the Teensy and the plant until `deadline_ns` or sooner; call it again at 1 kHz or more. The frame
  /// has its own thread.
  void service_until(std::int64_t deadline_ns);

  /// The Teensy changed its sync line at true time `mono_ns`; from the thread that serves.
  void sync_edge(std::int64_t mono_ns, bool is_high);

  [[nodiscard]] Rig& rig() noexcept { return rig_; }
  [[nodiscard]] const WireFrame& frame() const noexcept { return frame_; }
  [[nodiscard]] TeensyFaults& teensy_faults() noexcept { return teensy_->faults(); }
  [[nodiscard]] RegulatorFaults& regulator_faults() noexcept { return regulator_faults_; }
  /// Nothing where valves set the pressure.
  [[nodiscard]] const RegulatorServer* regulator() const noexcept { return regulator_.get(); }
  /// Where the frame is served: a TCP port, or 0; a pseudo-terminal, or "".
  [[nodiscard]] std::uint16_t frame_port() const noexcept {
    return std::visit([](const auto& frame) { return frame->server.port(); }, frame_);
  }
  [[nodiscard]] std::string frame_tty() const {
    return std::visit([](const auto& frame) { return frame->server.tty(); }, frame_);
  }

 private:
  const clock::Clock& clock_;
  std::int64_t start_ns_;
  std::string teensy_serial_;
  Rig rig_;
  WireFrame frame_;
  RegulatorFaults regulator_faults_;
  std::unique_ptr<RegulatorServer> regulator_;
  std::unique_ptr<EmulatedTeensy> teensy_;
};

}  // namespace isorig::sim
