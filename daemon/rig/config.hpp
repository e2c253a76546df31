#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "base/toml_reader.hpp"
#include "daemon/core/core.hpp"
#include "daemon/core/realtime.hpp"
#include "daemon/io/service_config.hpp"
#include "daemon/rig/notify_config.hpp"
#include "drivers/config/instron8800_config.hpp"
#include "drivers/config/modbus_config.hpp"
#include "drivers/config/regulator_config.hpp"
#include "drivers/interlock/gpio_interlock.hpp"
#include "drivers/pressure/teensy.hpp"
#include "protocol/limits.hpp"
#include "sim/config.hpp"

namespace isorig::daemon {

inline constexpr double kMiB = 1024.0 * 1024.0;

/// A rig's file, whole (docs/config.md has every key). Paths in it are relative to the file.
struct RigConfig {
  std::filesystem::path path;
  std::string text;
  std::string name;

  protocol::Limits limits;
  CoreConfig core;
  RealtimeConfig realtime;
  ServiceConfig services;
  /// In process, with the plant of [sim].
  struct SimulatedFrame {};
  /// What [frame] names. std::visit it with base::Overloaded: another kind of frame is an alternative here, and the
  /// compiler then lists every place that has to know it.
  std::variant<SimulatedFrame, modbus::ModbusConfig, frame::Instron8800Config> frame;
  struct Teensy {
    std::string port;  ///< its serial port; empty: over USB, by options.serial (docs/usb.md)
    pressure::Teensy::Options options;
    /// How messages name it.
    [[nodiscard]] std::string where() const { return port.empty() ? "USB serial number " + options.serial : port; }
  };
  std::optional<Teensy> teensy;  ///< none: the pressure side is simulated
  std::optional<pressure::RegulatorConfig> regulator;
  std::int64_t regulator_period_ns = 50'000'000;
  std::optional<interlock::GpioInterlock::Options> gpio;  ///< none: nobody watches the chain, or it is simulated
  /// Why nobody watches the chain of a rig on the wire; "" when somebody does. The chain then counts as closed.
  std::string unwatched_chain;
  std::optional<sim::SimConfig> sim;
  struct CalibrationPolicy {
    std::filesystem::path records;  ///< empty: RUNS/calibration/NAME
    bool refuse_overdue = false;    ///< else a warning
  } calibration;
  std::filesystem::path specimen;  ///< what is mounted, unless a run names another

  struct Recording {
    double sync_interval_s = 1.0;
    double virtual_sync_interval_s = 600.0;  ///< in virtual time a second of the run is no second of danger
    std::uint64_t min_free_bytes = std::uint64_t{512} << 20U;
    std::uint64_t reserve_bytes = std::uint64_t{32} << 20U;
    std::uint64_t max_segment_bytes = std::uint64_t{256} << 20U;
  } recording;

  struct Lcm {
    bool enabled = true;
    std::string url = "udpm://239.255.76.67:7667?ttl=0";
    std::int64_t period_ns = 10'000'000;  ///< a sample waits so long at most for its message
  } lcm;

  NotifyConfig notify;

  struct Api {
    std::filesystem::path socket;  ///< empty: daemon/host/paths.hpp
    unsigned mode = 0660;
    /// Groups whose members may, by name; empty: whoever may do what the line above says (daemon/host/roles.hpp).
    std::vector<std::string> see, operate, configure;
  } api;

  /// Its devices are emulated on this machine (isorig-simrig): on the wire, and nobody can be hurt.
  bool emulated = false;

  /// Everything in process and in virtual time if wanted: no device is outside.
  [[nodiscard]] bool simulated() const noexcept { return std::holds_alternative<SimulatedFrame>(frame) && !teensy; }
};

/// What the Teensy keeps to by itself. Half a psi above the limit: the daemon is to act first and to say why. They
/// follow the calibration in `rig`, since the device knows the sensor's own pressure alone.
[[nodiscard]] pressure::FillLimits fill_limits(const RigConfig& rig);

/// Reads and validates. Throws base::ConfigError with everything that is wrong.
[[nodiscard]] RigConfig load_rig(const std::filesystem::path& path);

}  // namespace isorig::daemon
