#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <iostream>

#include "base/printable.hpp"
#include "daemon/daemon.hpp"
#include "daemon/host/logging.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/host/run_reporter.hpp"
#include "daemon/host/stop_signals.hpp"
#include "daemon/revision.hpp"
#include "daemon/rig/config.hpp"
#include "daemon/threads.hpp"
#include "daemon/version.hpp"

namespace {
constexpr auto kLogPatience = std::chrono::milliseconds(500);
}

/// Exit codes: 0 stopped as asked, 1 failure, 2 usage, 3 wrong configuration, 8 no real-time rights.
int main(int argc, char** argv) {
  using namespace isorig;
  if (const auto why = base::why_not_arguments(argc, argv); !why.empty()) {
    std::cerr << "isorigd: " << why << '\n';
    return 2;
  }
  CLI::App app("The daemon that owns the rig", "isorigd");
  std::string rig_path, socket, diagnoses;
  std::string runs = daemon::default_runs().string();
  bool no_realtime = false, accept_late_ticks = false, check = false, no_report = false;
  app.add_option("--rig", rig_path, "The rig's file (config/rigs/)")->required();
  app.add_option("--runs", runs, "Where runs and their catalogue are kept")->capture_default_str();
  app.add_option(
      "--diagnoses", diagnoses,
      "Where diagnoses for the live page lie, beside those among the runs; `diagnoses` beside --runs if not given");
  app.add_option("--socket", socket, "The control socket, instead of the rig's [api] socket");
  app.add_flag("--no-realtime", no_realtime, "Do not insist on real-time rights; for a simulated rig on a desk");
  app.add_flag("--accept-late-ticks", accept_late_ticks,
               "With --no-realtime on a rig with real devices: its loop may stand still whenever the machine likes");
  app.add_flag("--check", check, "Read and validate the rig's file, then exit");
  app.add_flag("--no-report", no_report, "Write no page (report.html) of the runs");
  app.set_version_flag("--version", std::string("isorigd ") + daemon::kVersion + " (" + daemon::kRevision + ")");
  app.footer("Exit codes: 0 stopped as asked, 1 failure, 2 usage, 3 wrong configuration, 8 no real-time rights.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  try {
    auto rig = daemon::load_rig(rig_path);
    rig.realtime.enforce = !no_realtime;
    if (check) {
      if (const auto cpus = ::sysconf(_SC_NPROCESSORS_CONF); cpus > 0 && rig.realtime.cpu >= cpus) {
        std::cerr << "isorigd: note: [realtime] cpu = " << rig.realtime.cpu
                  << " is none of this machine's, which has 0 to " << cpus - 1 << '\n';
      }
      std::cout << base::printable(rig_path) << ": rig \"" << rig.name << "\" is valid\n";
      return 0;
    }
    if (no_realtime && !accept_late_ticks && !rig.simulated() && !rig.emulated) {
      std::cerr << "isorigd: rig \"" << rig.name
                << "\" has real devices, and without real-time rights its loop may stand still "
                << "whenever the machine likes; grant the rights (docs/threads.md), or say that you want this: "
                   "--accept-late-ticks\n";
      return 2;
    }
    daemon::DaemonOptions options;
    options.runs_root = runs;
    options.diagnoses_root = diagnoses.empty() ? daemon::diagnoses_beside(runs) : std::filesystem::path(diagnoses);
    options.revision = daemon::kRevision;
    if (!no_report) options.reporter = daemon::RunReporter::beside_this_program();
    options.socket = !socket.empty()           ? std::filesystem::path(socket)
                     : !rig.api.socket.empty() ? rig.api.socket
                                               : daemon::default_socket();
    daemon::set_stack_bytes(daemon::kStackBytes);  // before the log's thread
    const daemon::StopSignals signals;
    daemon::Logging logging;
    const int code = daemon::Daemon(rig, options, signals).run() ? 0 : 1;
    // A log whose thread waits for a terminal that stands still would be waited for at exit.
    if (!logging.drain(kLogPatience)) ::_exit(code);
    return code;
  } catch (const base::ConfigError& e) {
    std::cerr << e.what() << '\n';
    return 3;
  } catch (const daemon::RealtimeError& e) {
    std::cerr << "isorigd: " << base::printable_lines(e.what()) << '\n';
    return 8;
  } catch (const std::filesystem::filesystem_error& e) {
    std::cerr << "isorigd: cannot use " << base::printable(e.path1().string()) << ": " << e.code().message()
              << "; name another place (--runs, --socket), or check that it is a directory that you may write\n";
    return 1;
  } catch (const std::exception& e) {
    std::cerr << "isorigd: " << base::printable_lines(e.what()) << '\n';
    return 1;
  }
}
