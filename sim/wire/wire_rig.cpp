#include "sim/wire/wire_rig.hpp"

#include <poll.h>

#include <algorithm>
#include <ctime>

#include "base/overloaded.hpp"
#include "sim/specimen.hpp"
#include "sim/wire/pressure/teensy_pty.hpp"
#include "sim/wire/pressure/teensy_usbip.hpp"

namespace isorig::sim {
namespace {

SimConfig without_simulated_wires(const WireRigConfig& config) {
  SimConfig sim = config.sim;
  const DelayParameters none{0.0, 0.0, 0.0, 0.0};
  sim.frame.request = sim.frame.reply = none;
  sim.frame.exchange_interval_ms = 0.0;  // the register of the frame's time is right at every read
  // What the frame overwrites before a gateway that was held up has read it would be missing in the gateway's ring,
  // whose counter goes on: its slots would show the samples of one turn before.
  if (const auto* gateway = std::get_if<WireRigConfig::Modbus>(&config.frame)) {
    sim.frame.ring_samples = std::max(sim.frame.ring_samples, static_cast<int>(gateway->line.map.samples.slots));
  }
  sim.pressure.request = sim.pressure.reply = none;
  sim.pressure.sample_latency_ms = 0.0;
  // TeensyPty takes the backend's stamps as true time and puts a clock of its own on it.
  sim.pressure.clock = {0.0, 0.0, 0.0, 600.0};
  return sim;
}

RigOptions live(const clock::Clock& clock, std::int64_t start_ns, bool keep_truth) {
  RigOptions options;
  options.start_ns = start_ns;
  options.clock = &clock;
  options.threaded = true;
  options.keep_truth = keep_truth;
  return options;
}

ModbusServer::Options frame_options(const WireRigConfig::Modbus& config) {
  ModbusServer::Options options;
  options.map = config.line.map;
  options.tcp = config.line.transport == modbus::ModbusTransport::kTcp;
  options.tcp_address = config.line.host;
  options.tcp_port = config.line.port;
  options.pty_link = options.tcp ? config.rtu_link : config.line.tty;
  options.pty = !options.pty_link.empty();
  return options;
}

Instron8800Server::Options frame_options(const WireRigConfig::Instron8800& config) {
  auto options = config.controller;
  options.tcp = config.line.tcp;
  options.tcp_address = config.line.host;
  options.tcp_port = config.line.port;
  options.pty_link = config.line.tty;
  options.position_channel = config.line.position_channel;
  options.force_channel = config.line.force_channel;
  return options;
}

WireFrame make_frame(const WireRigConfig& config, Rig& rig) {
  return std::visit(
      base::Overloaded{
          [&](const WireRigConfig::Modbus& c) -> WireFrame { return std::make_unique<WireModbus>(c, rig); },
          [&](const WireRigConfig::Instron8800& c) -> WireFrame { return std::make_unique<WireInstron8800>(c, rig); }},
      config.frame);
}

RegulatorServer::Options regulator_options(const pressure::RegulatorConfig& config) {
  RegulatorServer::Options options;
  options.tcp = config.line.transport == modbus::ModbusTransport::kTcp;
  options.tcp_address = config.line.host;
  options.tcp_port = config.line.port;
  options.pty_link = config.line.tty;
  options.unit_id = config.line.map.unit_id;
  return options;
}

std::unique_ptr<EmulatedTeensy> make_teensy(const WireRigConfig& config, const std::string& serial,
                                            pressure::Device& backend, std::int64_t start_ns,
                                            const clock::Clock& clock) {
  EmulatedTeensy::Options options;
  options.core.serial = serial.c_str();
  options.core.sample_rate_mhz = static_cast<std::uint32_t>(config.sim.pressure.sample_rate_hz * 1000.0);
  options.core.watchdog_ms = static_cast<std::uint16_t>(config.sim.pressure.watchdog_s * 1000.0);
  options.skew_ppm = config.sim.pressure.clock.skew_ppm;
  options.start_us = static_cast<std::uint64_t>(config.sim.pressure.clock.offset_us);
  options.backend_epoch_ns = start_ns;
  options.clock = &clock;
  const std::int64_t now_ns = clock.now_ns();
  if (config.teensy_link.empty()) return std::make_unique<TeensyUsbip>(options, backend, now_ns);
  return std::make_unique<TeensyPty>(config.teensy_link, options, backend, now_ns);
}

Instron8800Server::Options read_controller(const base::TomlTable& root) {
  Instron8800Server::Options c;
  const auto t = root.table("sim").table_if("controller");
  if (!t) return c;
  c.position_full_scale_mm = t->number_or("position_full_scale_mm", c.position_full_scale_mm, base::kPositive);
  c.force_full_scale_N = t->number_or("force_full_scale_N", c.force_full_scale_N, base::kPositive);
  c.watchdog_s = t->number_or("watchdog_s", c.watchdog_s, base::kPositive);
  c.answer_us = static_cast<int>(t->integer_or("answer_us", c.answer_us, {0.0, 1e6}));
  using Watchdog = Instron8800Server::Options::Watchdog;
  const auto watchdog = t->choice_or("watchdog", "two-numbers", {"two-numbers", "one-number", "not-asked"});
  c.watchdog = watchdog == "two-numbers"  ? Watchdog::kTwoNumbers
               : watchdog == "one-number" ? Watchdog::kOneNumber
                                          : Watchdog::kNotAsked;
  c.answers_unknown = t->boolean_or("answers_unknown", c.answers_unknown);
  c.takes_sign = t->boolean_or("takes_sign", c.takes_sign);
  c.ends_ramps = t->boolean_or("ends_ramps", c.ends_ramps);
  c.ramp_of_scale_per_s = t->number_or("ramp_of_scale_per_s", c.ramp_of_scale_per_s, base::kNonNegative);
  return c;
}

}  // namespace

WireModbus::WireModbus(const WireRigConfig::Modbus& config, Rig& rig)
    : server(frame_options(config), rig.frame(), faults) {}

WireInstron8800::WireInstron8800(const WireRigConfig::Instron8800& config, Rig& rig)
    : server(frame_options(config), rig.frame(), faults) {}

WireRigConfig read_wire_rig(const std::filesystem::path& rig_file) {
  const auto document = base::TomlDocument::parse_file(rig_file);
  const auto root = document.root();
  const auto directory = std::filesystem::weakly_canonical(rig_file).parent_path();
  WireRigConfig config;
  config.sim = read_sim(root, directory);
  const auto frame = root.table("frame");
  (void)frame.string_or("zero", "");  // the daemon's
  if (frame.choice("driver", {"modbus", "instron8800"}) == "instron8800") {
    config.frame = WireRigConfig::Instron8800{frame::read_instron8800_config(frame), read_controller(root)};
  } else {
    config.frame = WireRigConfig::Modbus{modbus::read_modbus_config(frame, directory), {}};
  }
  const auto pressure = root.table("pressure");
  (void)pressure.choice("driver", {"teensy"});
  if (pressure.string_or("transport", pressure.has("port") ? "tty" : "usb") == "tty")
    config.teensy_link = pressure.string("port");
  config.teensy_serial = pressure.string_or("serial", config.teensy_serial);
  pressure.ignore_rest();
  if (const auto t = root.table_if("regulator")) {
    config.regulator = pressure::read_regulator_config(*t, directory);
    t->ignore_rest();
  }
  root.ignore_rest();  // the daemon's own tables
  document.finish();
  return config;
}

WireRig::WireRig(const WireRigConfig& config, const clock::Clock& clock, bool keep_truth)
    : clock_(clock),
      start_ns_(clock.now_ns()),
      teensy_serial_(config.teensy_serial),
      rig_(without_simulated_wires(config), load_specimen(config.sim.specimen), live(clock, start_ns_, keep_truth)),
      frame_(make_frame(config, rig_)),
      regulator_(config.regulator
                     ? std::make_unique<RegulatorServer>(regulator_options(*config.regulator), rig_, regulator_faults_)
                     : nullptr),
      teensy_(make_teensy(config, teensy_serial_, rig_.pressure(), start_ns_, clock)) {
  rig_.interlock().connect();
  rig_.interlock().hold_pressure(true);  // the interlock has no wire here: energised until the stop is pressed
}

void WireRig::sync_edge(std::int64_t mono_ns, bool is_high) {
  teensy_->sync_edge(mono_ns, is_high);
}

void WireRig::service_until(std::int64_t deadline_ns) {
  for (;;) {
    teensy_->service(clock_.now_ns());
    const std::int64_t left_ns = deadline_ns - clock_.now_ns();
    if (left_ns <= 0) return;
    // A request of the host is answered when it comes, not at the next millisecond: time exchanges are
    // symmetric.
    pollfd port{teensy_->is_open() ? teensy_->fd() : -1, POLLIN, 0};
    const timespec wait{0, std::min<std::int64_t>(left_ns, 1'000'000)};
    ::ppoll(&port, 1, &wait, nullptr);
  }
}

}  // namespace isorig::sim
