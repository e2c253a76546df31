#include "daemon/rig/config.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <sstream>

#include "base/overloaded.hpp"
#include "base/printable.hpp"
#include "daemon/rig/config_checks.hpp"
#include "daemon/rig/specimen.hpp"
#include "messages/elvh.hpp"

namespace isorig::daemon {
namespace {

Calibration read_calibration(const base::TomlTable& table) {
  Calibration c;
  const auto scale = [&](const char* key) {
    const double value = table.number_or(key, 1.0);
    if (value == 0.0) table.error(key, std::string("`") + key + "` is 0; a scale has to be another number");
    return value;
  };
  c.position_scale = scale("position_scale");
  c.position_offset_mm = table.number_or("position_offset_mm", 0.0);
  c.force_scale = scale("force_scale");
  c.force_offset_N = table.number_or("force_offset_N", 0.0);
  c.pressure_scale = scale("pressure_scale");
  c.pressure_offset_psi = table.number_or("pressure_offset_psi", 0.0);
  return c;
}

RigConfig::Teensy read_teensy(const base::TomlTable& table) {
  RigConfig::Teensy t;
  if (table.choice_or("transport", table.has("port") ? "tty" : "usb", {"usb", "tty"}) == "tty") {
    t.port = table.string("port");
    t.options.serial = table.string_or("serial", "");
  } else {
    t.options.serial = table.string("serial");
    if (!table.string_or("port", "").empty())
      table.error("port", "`port` goes with transport = \"tty\"; over USB the serial number finds the device");
  }
  t.options.model = table.string_or("model", t.options.model);
  t.options.connect_timeout_ns = static_cast<std::int64_t>(
      1e9 *
      table.number_or("connect_timeout_s", static_cast<double>(t.options.connect_timeout_ns) * 1e-9, {0.1, 60.0}));
  t.options.command_validity_ms =
      static_cast<std::uint16_t>(table.integer_or("command_validity_ms", t.options.command_validity_ms, {20, 5000}));
  return t;
}

std::optional<interlock::GpioLine> read_gpio_line(const base::TomlTable& table, const char* key,
                                                  bool fails_safe = true) {
  const auto line = table.table_if(key);
  if (!line) return std::nullopt;
  interlock::GpioLine read;
  read.line = line->string("line");
  read.active_low = line->boolean_or("active_low", false);
  const auto bias = line->choice_or("bias", "as-is", {"as-is", "disabled", "pull-up", "pull-down"});
  if (bias == "disabled") read.bias = interlock::Bias::kDisabled;
  if (bias == "pull-up") read.bias = interlock::Bias::kPullUp;
  if (bias == "pull-down") read.bias = interlock::Bias::kPullDown;
  if (fails_safe && read.bias == (read.active_low ? interlock::Bias::kPullDown : interlock::Bias::kPullUp)) {
    line->error("bias",
                "with this `bias` the line is active when its wire is broken; change `active_low` or the wiring");
  }
  return read;
}

interlock::GpioInterlock::Options read_gpio(const base::TomlTable& table) {
  interlock::GpioInterlock::Options o;
  o.chip = table.string("chip");
  if (const auto estop = read_gpio_line(table, "estop")) {
    o.estop = *estop;
  } else {
    table.error("estop", "`estop = { line = \"...\" }` is missing: the emergency-stop chain has to be watched");
  }
  o.guard = read_gpio_line(table, "guard");
  o.vent_valve = read_gpio_line(table, "vent_valve");
  o.sync = read_gpio_line(table, "sync", false);
  o.closing_ns = static_cast<std::int64_t>(
      std::llround(table.number_or("closing_ms", static_cast<double>(o.closing_ns) * 1e-6, {0.0, 10'000.0}) * 1e6));
  return o;
}

bool loopback(const std::string& host) {
  return host.starts_with("127.") || host == "::1" || host == "localhost";
}

bool is_on_another_machine(const decltype(RigConfig::frame)& frame) {
  return std::visit(base::Overloaded{[](const RigConfig::SimulatedFrame&) { return false; },
                                     [](const modbus::ModbusConfig& c) {
                                       return c.transport == modbus::ModbusTransport::kTcp && !loopback(c.host);
                                     },
                                     [](const frame::Instron8800Config& c) { return c.tcp && !loopback(c.host); }},
                    frame);
}

/// `emulated = true`: isorig-simrig plays the devices. It serves this machine only.
bool read_emulated(const base::TomlTable& root, const RigConfig& rig) {
  if (!root.boolean_or("emulated", false)) return false;
  if (rig.simulated()) {
    root.error("emulated", "`emulated` is for devices on the wire; this rig is simulated in process");
  } else if (is_on_another_machine(rig.frame)) {
    root.error("emulated",
               "`emulated` = true, and [frame] host is another machine: isorig-simrig serves 127.0.0.1 only, so this "
               "is a real frame; take `emulated` out");
  }
  return true;
}

void read_interlock(const base::TomlTable& table, RigConfig& rig) {
  const auto driver = table.choice("driver", {"sim", "gpio", "none"});
  if (driver == "gpio") {
    rig.gpio = read_gpio(table);
    if (rig.simulated()) table.error("driver", "a simulated rig has its own interlock: driver = \"sim\"");
  } else if (driver == "none") {
    rig.unwatched_chain = table.string_or("reason", "");
    if (rig.simulated()) {
      table.error("driver", "a simulated rig has its own interlock: driver = \"sim\"");
    } else if (rig.unwatched_chain.size() < 10) {
      table.error("reason",
                  "`reason` has to say, in ten letters or more, why nobody watches this rig's emergency-stop chain and "
                  "what stops it instead");
    }
  } else if (!rig.simulated() && !rig.emulated) {
    table.error(
        "driver",
        "`driver` = \"sim\" on a rig with real devices: an emergency stop would count as closed and nobody would look; "
        "wire the chain "
        "to driver = \"gpio\" (docs/gpio.md), or say that nobody watches it: driver = \"none\" with reason = \"...\"; "
        "if isorig-simrig plays the devices, emulated = true at the top");
  } else if (rig.emulated) {
    rig.unwatched_chain = "the devices are emulated (isorig-simrig)";
  }
}

NotifyConfig read_notify(const base::TomlTable& table) {
  NotifyConfig o;
  o.command = table.string("command");
  if (o.command.is_relative()) {
    table.error("command", "`command` has to be an absolute path, such as \"/usr/local/bin/isorig-mail\"");
  } else if (::access(o.command.c_str(), X_OK) != 0 || std::filesystem::is_directory(o.command)) {
    table.error("command",
                "`command` = \"" + o.command.string() + "\" cannot be run: " +
                    (errno == ENOENT ? "there is no such file" : "it is not an executable file for this user") +
                    "; arguments go into a script of its own");
  }
  o.timeout_s = table.number_or("timeout_s", o.timeout_s, {1.0, 600.0});
  o.interval_s = table.number_or("interval_s", o.interval_s, {0.1, 3600.0});
  o.held_s = table.number_or("held_s", o.held_s, {0.0, 1e6});
  return o;
}

ServiceConfig read_services(const base::TomlTable& table) {
  ServiceConfig c;
  const auto ms = [&](const char* key, std::int64_t fallback_ns, base::Range range) {
    return static_cast<std::int64_t>(
        std::llround(table.number_or(key, static_cast<double>(fallback_ns) * 1e-6, range) * 1e6));
  };
  c.poll_period_ns = ms("poll_period_ms", c.poll_period_ns, {1.0, 100.0});
  c.heartbeat_period_ns = ms("heartbeat_period_ms", c.heartbeat_period_ns, {5.0, 1000.0});
  c.sync_period_ns = ms("sync_period_ms", c.sync_period_ns, {50.0, 10'000.0});
  c.sync_burst = static_cast<int>(table.integer_or("sync_burst", c.sync_burst, {4, 1000}));
  return c;
}

void read_sides(const base::TomlTable& frame, const base::TomlTable& pressure, const std::filesystem::path& directory,
                RigConfig& rig) {
  const auto frame_driver = frame.choice("driver", {"sim", "modbus", "instron8800"});
  if (frame_driver == "modbus") {
    rig.frame = modbus::read_modbus_config(frame, directory);
  } else if (frame_driver == "instron8800") {
    rig.frame = frame::read_instron8800_config(frame);
  }
  rig.core.frame_zero = FrameZero::kFirstHolds;
  if (frame_driver != "sim") {
    rig.core.frame_zero = frame.choice_or("zero", "confirm", {"confirm", "absolute"}) == "confirm"
                              ? FrameZero::kConfirm
                              : FrameZero::kAbsolute;
  }
  const auto pressure_driver = pressure.choice("driver", {"sim", "teensy"});
  if (pressure_driver == "teensy") rig.teensy = read_teensy(pressure);
  if ((frame_driver == "sim") != (pressure_driver == "sim")) {
    pressure.error("driver", "a simulated frame goes with a simulated pressure side: they share one plant");
  }
}

void read_regulator(const base::TomlTable& t, const std::filesystem::path& directory, RigConfig& rig) {
  rig.regulator = pressure::read_regulator_config(t, directory);
  rig.limits.regulator_max_psi = rig.core.pressure_loop.regulator_max_psi = rig.regulator->max_psi;
  auto& s = rig.core.supervisor;
  s.regulator_age_max_s = t.number_or("age_max_s", 0.5, base::kPositive);
  s.regulator_error_max_psi = t.number_or("error_max_psi", s.regulator_error_max_psi, base::kPositive);
  rig.regulator_period_ns = static_cast<std::int64_t>(1e6 * t.number_or("poll_period_ms", 50.0, {5.0, 1000.0}));
  if (rig.simulated()) t.error("", "[regulator] is for a rig on the wire; a simulated rig has valves");
}

void read_recorder(const base::TomlTable& t, RigConfig& rig) {
  auto& r = rig.recording;
  r.sync_interval_s = t.number_or("sync_interval_s", r.sync_interval_s, {0.1, 60.0});
  r.virtual_sync_interval_s = t.number_or("virtual_sync_interval_s", r.virtual_sync_interval_s, {0.1, 1e6});
  const auto mib = [&](const char* key, std::uint64_t& bytes) {
    bytes = static_cast<std::uint64_t>(t.number_or(key, static_cast<double>(bytes) / kMiB, {1.0, 1e6}) * kMiB);
  };
  mib("min_free_MiB", r.min_free_bytes);
  mib("reserve_MiB", r.reserve_bytes);
  mib("max_segment_MiB", r.max_segment_bytes);
}

/// "one, another". Whether this machine has such groups is asked by the daemon: a rig file is checked on others, too.
std::vector<std::string> group_names(const base::TomlTable& t, const char* key) {
  const auto text = t.string_or(key, "");
  std::vector<std::string> names;
  std::string name;
  for (std::istringstream words(text); std::getline(words, name, ',');) {
    const auto from = name.find_first_not_of(' '), to = name.find_last_not_of(' ');
    name = from == std::string::npos ? "" : name.substr(from, to - from + 1);
    if (name.empty() || name.find_first_of(" :/") != std::string::npos) {
      t.error(key, "`" + std::string(key) + "` = \"" + text + "\"; it has to name Unix groups, separated by commas");
      return {};
    }
    names.push_back(name);
  }
  return names;
}

void read_api(const base::TomlTable& t, RigConfig& rig) {
  rig.api.socket = t.string_or("socket", "");
  const auto mode = t.string_or("mode", "0660");
  std::size_t used = 0;
  unsigned long value = 0;
  try {
    value = std::stoul(mode, &used, 8);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != mode.size() || value > 0777) {
    t.error("mode", "`mode` = \"" + mode + "\"; it has to be an octal file mode such as \"0660\"");
  } else {
    rig.api.mode = static_cast<unsigned>(value);
  }
  rig.api.see = group_names(t, "see");
  rig.api.operate = group_names(t, "operate");
  rig.api.configure = group_names(t, "configure");
}

/// On a real rig the ages that the file leaves out end no later than the Teensy's own watchdog: it vents then, and what
/// the daemon does afterwards comes too late.
void default_ages_of_a_real_rig(const base::TomlTable& root, SupervisorConfig& supervisor) {
  const auto table = root.table_if("supervisor");
  const auto shorten = [&](const char* key, double& age_s) {
    if (!table || !table->has(key)) age_s = std::min(age_s, kTeensyWatchdog_s);
  };
  shorten("pressure_age_max_s", supervisor.pressure_age_max_s);
  shorten("late_tick_max_s", supervisor.late_tick_max_s);
}

/// A run would be refused without it, hours after somebody was told that the rig is valid.
void check_specimen(const base::TomlTable& root, const RigConfig& rig) {
  if (rig.specimen.empty()) return;
  const auto sim = root.table_if("sim");
  const bool of_sim = rig.simulated() && sim;
  try {
    (void)load_specimen(rig.specimen);
  } catch (const base::ConfigError& e) {
    for (const auto& fault : e.diagnostics()) (of_sim ? *sim : root).error("specimen", "`specimen`: " + fault.text());
  }
}

}  // namespace

pressure::FillLimits fill_limits(const RigConfig& rig) {
  constexpr double kMarginPsi = 0.5;
  const auto& loop = rig.core.pressure_loop;
  const auto& calibration = rig.core.calibration;
  pressure::FillLimits limits;
  // The device knows the sensor's own pressure, not the calibrated one; it takes nothing beyond the sensor's range.
  const double raw_psi =
      (rig.limits.pressure_max_psi + kMarginPsi - calibration.pressure_offset_psi) / calibration.pressure_scale;
  limits.pressure_max_psi = std::clamp(raw_psi, 0.1, messages::kElvhSpanPsi);
  if (loop.actuator == PressureLoopConfig::Actuator::kValves) {
    limits.fill_allowance_permille = static_cast<std::uint16_t>(std::lround(1000.0 * loop.fill_allowance()));
    limits.fill_max_ms = static_cast<std::uint32_t>(
        std::clamp(1000.0 * loop.fill_time_bound_s(rig.limits.pressure_max_psi), 100.0, 60'000.0));
  }
  return limits;
}

RigConfig load_rig(const std::filesystem::path& path) {
  const auto document = base::TomlDocument::parse_file(path);
  const auto root = document.root();
  // The file itself, not the link that chose it: /etc/isorig/rig.toml -> rigs/lab.toml.
  const auto directory = std::filesystem::weakly_canonical(path).parent_path();
  RigConfig rig;
  rig.path = path;
  rig.text = document.text();
  (void)root.choice("format", {"isorig-rig/1"});
  rig.name = root.string("name");
  if (const auto why = base::why_not_a_name(rig.name); !why.empty() && root.type_of("name") == "string") {
    root.error("name", "`name` = \"" + rig.name + "\" " + why);
  }
  (void)root.string_or("description", "");

  const auto limits = root.table("limits");
  rig.limits = protocol::read_limits(limits);

  const auto pressure = root.table("pressure");
  read_sides(root.table("frame"), pressure, directory, rig);
  rig.emulated = read_emulated(root, rig);
  read_interlock(root.table("interlock"), rig);

  const auto table = [&](const char* name, auto&& read) {
    if (const auto t = root.table_if(name)) read(*t);
  };
  rig.core.supervisor.limits = rig.limits;
  table("supervisor", [&](const auto& t) {
    rig.core.supervisor = SupervisorConfig::read(t, rig.limits);
    rig.core.recorder_age_max_s = t.number_or("recorder_age_max_s", rig.core.recorder_age_max_s, {0.2, 60.0});
  });
  if (!rig.simulated() && !rig.emulated) default_ages_of_a_real_rig(root, rig.core.supervisor);
  const bool on_the_wire = !rig.simulated();
  rig.core.operating = OperatorConfig::defaults(rig.limits, on_the_wire);
  table("operator", [&](const auto& t) { rig.core.operating = OperatorConfig::read(t, rig.limits, on_the_wire); });
  rig.core.supervisor.guard_open_in_setup = rig.core.operating.jog_with_guard_open;
  table("pressure_loop", [&](const auto& t) { rig.core.pressure_loop = PressureLoopConfig::read(t); });
  rig.limits.loop_rate_max_psi_s = rig.core.pressure_loop.rate_limit_psi_s;
  table("regulator", [&](const auto& t) { read_regulator(t, directory, rig); });
  if (rig.regulator.has_value() != (rig.core.pressure_loop.actuator == PressureLoopConfig::Actuator::kRegulator)) {
    pressure.error("", rig.regulator ? "[regulator] is there, and [pressure_loop] has no actuator = \"regulator\""
                                     : "[pressure_loop] actuator = \"regulator\" needs a [regulator]");
  }
  table("calibration", [&](const auto& t) {
    rig.core.calibration = read_calibration(t);
    if (const auto records = t.string_or("records", ""); !records.empty())
      rig.calibration.records = directory / records;
    rig.calibration.refuse_overdue = t.choice_or("overdue", "warn", {"warn", "refuse"}) == "refuse";
  });
  table("realtime", [&](const auto& t) { rig.realtime = RealtimeConfig::read(t); });
  table("services", [&](const auto& t) { rig.services = read_services(t); });
  table("recorder", [&](const auto& t) { read_recorder(t, rig); });
  table("lcm", [&](const auto& t) {
    rig.lcm.enabled = t.boolean_or("enabled", rig.lcm.enabled);
    rig.lcm.url = t.string_or("url", rig.lcm.url);
    rig.lcm.period_ns = t.integer_or("period_ms", rig.lcm.period_ns / 1'000'000, {1, 100}) * 1'000'000;
  });
  table("notify", [&](const auto& t) { rig.notify = read_notify(t); });
  table("api", [&](const auto& t) { read_api(t, rig); });
  if (std::holds_alternative<RigConfig::SimulatedFrame>(rig.frame)) {
    rig.sim = sim::read_sim(root, directory);
    rig.specimen = rig.sim->specimen;
  } else {
    const auto specimen = root.string_or("specimen", "");
    if (!specimen.empty()) rig.specimen = directory / specimen;
    if (const auto t = root.table_if("sim")) t->ignore_rest();  // for the emulator that plays this rig
  }
  rig.services.fill_limits = fill_limits(rig);
  check_specimen(root, rig);
  check_rig(rig, root);
  document.finish();
  return rig;
}

}  // namespace isorig::daemon
