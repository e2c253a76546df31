// isorig-simrig: a simulated rig on the wire, for the daemon and its drivers as they are
// (docs/wire-frame.md).
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "base/overloaded.hpp"
#include "base/toml_reader.hpp"
#include "drivers/clock/real_clock.hpp"
#include "sim/wire/control_socket.hpp"
#include "sim/wire/gpio_lines.hpp"
#include "sim/wire/wire_control.hpp"
#include "sim/wire/wire_rig.hpp"

namespace {

using namespace isorig;

volatile std::sig_atomic_t stop_asked = 0;

struct CloseFile {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

/// What the plant really did, one line per physics step: 1 ms apart, also where the host stood still.
class TruthLog {
 public:
  explicit TruthLog(const std::string& path) : file_(std::fopen(path.c_str(), "w")) {
    if (!file_) throw std::runtime_error("cannot write " + path);
    std::fputs("mono_ns,position_mm,force_N,pressure_psi\n", file_.get());
  }
  void write(const std::vector<sim::Truth>& steps) {
    for (const auto& truth : steps) {
      std::fprintf(file_.get(), "%lld,%.6f,%.5f,%.5f\n", static_cast<long long>(truth.mono_ns), truth.position_mm,
                   truth.force_N, truth.pressure_psi);
    }
  }

 private:
  std::unique_ptr<std::FILE, CloseFile> file_;
};

struct Arguments {
  std::string rig;
  std::string truth;
  std::string control;
  std::vector<std::string> faults;
  double duration_s = 0.0;
  std::optional<std::uint16_t> port;
  std::string rtu;
  std::string teensy;
  sim::GpioLines::Options lines;
};

int serve(const Arguments& arguments) {
  auto config = sim::read_wire_rig(arguments.rig);
  if (arguments.port) std::visit([&](auto& frame) { frame.line.port = *arguments.port; }, config.frame);
  if (!arguments.rtu.empty()) {
    auto* modbus = std::get_if<sim::WireRigConfig::Modbus>(&config.frame);
    if (modbus == nullptr) {
      std::fputs("isorig-simrig: --rtu is for a frame on Modbus, and this rig's frame is none\n", stderr);
      return 2;
    }
    modbus->rtu_link = arguments.rtu;
  }
  if (!arguments.teensy.empty()) config.teensy_link = arguments.teensy;

  clock::RealClock clock;
  sim::WireRig rig(config, clock, !arguments.truth.empty());
  sim::WireControl control(rig);
  for (const auto& fault : arguments.faults) {
    const auto answer = control.execute("fault " + fault);
    if (answer != "ok\n") {
      std::fprintf(stderr, "isorig-simrig: --fault \"%s\": %s", fault.c_str(), answer.c_str());
      return 2;
    }
  }
  std::optional<sim::ControlSocket> socket;
  if (!arguments.control.empty()) {
    socket.emplace(arguments.control, [&](std::string_view line) { return control.execute(line); });
  }
  sim::GpioLines lines(arguments.lines, rig, clock);
  std::optional<TruthLog> truth;
  if (!arguments.truth.empty()) truth.emplace(arguments.truth);

  if (rig.frame_port() != 0) {
    const auto host = std::visit([](const auto& frame) { return frame.line.host; }, config.frame);
    std::printf("frame: tcp %s:%u\n", host.c_str(), rig.frame_port());
  }
  if (!rig.frame_tty().empty()) {
    const auto* line = std::visit(base::Overloaded{[](const sim::WireRigConfig::Modbus&) { return "rtu"; },
                                                   [](const sim::WireRigConfig::Instron8800&) { return "tty"; }},
                                  config.frame);
    std::printf("frame: %s %s\n", line, rig.frame_tty().c_str());
  }
  std::printf("pressure: %s\n", config.teensy_link.empty() ? ("USB serial number " + config.teensy_serial).c_str()
                                                           : config.teensy_link.c_str());
  if (rig.regulator() != nullptr) {
    if (rig.regulator()->port() != 0) {
      std::printf("regulator: tcp %s:%u\n", config.regulator->line.host.c_str(), rig.regulator()->port());
    } else {
      std::printf("regulator: rtu %s\n", config.regulator->line.tty.c_str());
    }
  }
  if (socket) std::printf("control: %s\n", arguments.control.c_str());
  std::puts("ready; stop with Ctrl-C");
  std::fflush(stdout);

  const std::int64_t start_ns = clock.now_ns();
  std::int64_t next_ns = start_ns;
  while (stop_asked == 0 &&
         (arguments.duration_s <= 0.0 || static_cast<double>(next_ns - start_ns) * 1e-9 < arguments.duration_s)) {
    next_ns = std::max(next_ns + 1'000'000, clock.now_ns());  // after a stall: go on, do not catch up
    rig.service_until(next_ns);
    lines.service();
    if (truth) truth->write(rig.rig().take_truth());
    if (socket) socket->service();
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "A simulated rig in real time: its frame on Modbus or as an 8800-type controller, its Teensy on a "
      "pseudo-terminal or on USB."};
  Arguments arguments;
  app.add_option("--rig", arguments.rig, "rig file; serves what its [frame] and [pressure] connect to")
      ->type_name("FILE");
  app.add_option("--truth", arguments.truth, "write what the plant really does, as CSV")->type_name("FILE");
  app.add_option("--control", arguments.control, "take fault commands on this Unix socket")->type_name("SOCKET");
  app.add_option("--fault", arguments.faults, "switch a fault on from the start, such as \"frame delay 20\"");
  app.add_option("--duration", arguments.duration_s, "stop after so many seconds; 0: never");
  app.add_option("--port", arguments.port, "TCP port instead of the rig file's; 0: a free one, printed");
  app.add_option("--rtu", arguments.rtu, "serve the frame over RTU too, on a pseudo-terminal linked here");
  app.add_option("--teensy", arguments.teensy, "link to the Teensy's pseudo-terminal instead of the rig file's");
  app.add_option("--gpio-sync", arguments.lines.sync_pull,
                 "raise the sync line through this `pull` of a gpio-sim line (docs/virtual-bench.md)");
  app.add_option("--gpio-vent", arguments.lines.vent_value, "the dump valve follows this `value` of a gpio-sim line");
  auto* send = app.add_subcommand("send",
                                  "send one line to a running isorig-simrig: \"fault frame delay 200\", "
                                  "\"clear\", \"list\", \"truth pressure\"");
  std::string socket, line;
  send->add_option("SOCKET", socket, "its --control")->required();
  send->add_option("LINE", line)->required();
  app.set_version_flag("--version", std::string("isorig-simrig ") + ISORIG_VERSION);
  app.footer("Exit codes: 0 stopped as asked, 1 failure, 2 usage, 3 wrong configuration.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  try {
    if (*send) {
      const auto answer = sim::ControlSocket::ask(socket, line);
      std::fputs(answer.c_str(), stdout);
      return answer.starts_with("error") || answer.empty() ? 1 : 0;
    }
    if (arguments.rig.empty()) {
      std::fputs("isorig-simrig: --rig FILE is needed, such as config/rigs/sim-wire.toml\n", stderr);
      return 2;
    }
    struct sigaction on_stop {};
    on_stop.sa_handler = [](int) { stop_asked = 1; };
    sigaction(SIGINT, &on_stop, nullptr);
    sigaction(SIGTERM, &on_stop, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
    return serve(arguments);
  } catch (const base::ConfigError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "isorig-simrig: %s\n", error.what());
    return 1;
  }
}
