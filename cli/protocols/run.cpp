#include <charconv>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>

#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/provenance.hpp"
#include "cli/runs/run_report.hpp"
#include "cli/screen/progress.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/host/virtual_run.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/revision.hpp"

/// isorig run: a protocol on a simulated rig, all in this process, in virtual time.
namespace isorig::cli {
namespace {

volatile std::sig_atomic_t stop_requested = 0;

struct RunOptions {
  std::string protocol, rig, specimen, resume;
  std::string runs = daemon::default_runs().string();
  std::uint64_t seed = 0;
  bool has_seed = false;
  bool aborted = false, on_another_rig = false, another_specimen = false;
  bool json = false;
  bool quiet = false;
  bool report = true;
};

void print_run_result(const daemon::VirtualRunResult& r) {
  const auto& rec = r.recorder;
  const auto missing = rec.frame_missing + rec.pressure_missing + rec.dropped_records;
  std::printf("run %s: %s%s%s\n", r.run_id.c_str(), r.outcome.c_str(), r.fault.empty() ? "" : ": ", r.fault.c_str());
  std::printf("  %s of rig time, %llu ticks, in %.1f s (%.0f times real time)\n", duration_text(r.simulated_s).c_str(),
              static_cast<unsigned long long>(r.ticks), r.wall_s, r.simulated_s / std::max(r.wall_s, 1e-9));
  std::printf(
      "  recorded: force and position %llu samples in full, %llu in averages; pressure %llu and %llu; missing %llu\n",
      static_cast<unsigned long long>(rec.frame_full), static_cast<unsigned long long>(rec.frame_averaged),
      static_cast<unsigned long long>(rec.pressure_full), static_cast<unsigned long long>(rec.pressure_averaged),
      static_cast<unsigned long long>(missing));
  std::printf("  %.1f MiB in %s\n", static_cast<double>(rec.written_bytes) / 1048576.0, r.directory.string().c_str());
}

int exit_code(const daemon::VirtualRunResult& r) {
  if (r.outcome == "failed") return kTripped;
  if (r.outcome != "done") return kFailure;
  const auto& rec = r.recorder;
  return rec.frame_missing + rec.pressure_missing + rec.dropped_records + rec.lost_messages > 0 ? kDataLost : kOk;
}

/// The run stands without its page: what goes wrong with that is said, and changes nothing. "" then.
std::string write_page(const RunOptions& o, const daemon::VirtualRunResult& result) {
  const auto file = result.directory / kRunReport;
  try {
    RunArgument which;
    which.run = result.directory.string();
    std::vector<std::pair<std::string, std::string>> inputs{{"Rig", o.rig}};
    if (!o.protocol.empty()) inputs.emplace_back("Protocol", o.protocol);
    if (!o.specimen.empty()) inputs.emplace_back("Specimen", o.specimen);
    inputs.emplace_back("Run", result.directory.string());
    Progress progress("report", !o.quiet);
    write_run_report(find_run(which), file, made_by_this_call(std::move(inputs)),
                     [&](double fraction, const char* doing) { progress.at(fraction, doing); });
    return file.string();
  } catch (const std::exception& e) {
    std::cerr << "isorig run: the run's page was not written: " << e.what() << "; try `isorig report " << result.run_id
              << "`\n";
    return {};
  }
}

int run(const RunOptions& o) {
  auto rig = daemon::load_rig(o.rig);
  daemon::VirtualRunOptions options;
  options.runs_root = o.runs;
  options.revision = daemon::kRevision;
  if (o.has_seed) options.seed = o.seed;
  if (o.resume.empty()) {
    options.start.protocol_text = base::read_config_file(o.protocol);
    options.start.protocol_name = o.protocol;
  } else {
    options.start.resume_run = o.resume;
    options.start.resume_aborted = o.aborted;
    options.start.on_another_rig = o.on_another_rig;
    options.start.another_specimen = o.another_specimen;
  }
  options.specimen = o.specimen;
  std::optional<Progress> progress(std::in_place, "run", !o.quiet);
  options.on_progress = [&](const daemon::Status& s, double) {
    progress->at(double{s.control.progress},
                 duration_text(static_cast<double>(s.control.mono_ns) * 1e-9) + " of rig time");
  };
  stop_requested = 0;
  // Whoever ends it, with Ctrl-C, a time limit or by closing the terminal: the run is aborted and closed. A reader that
  // goes away (isorig run | head) ends nothing.
  const auto previous = std::signal(SIGINT, [](int) { stop_requested = 1; });
  for (const int number : {SIGTERM, SIGHUP, SIGQUIT}) {
    if (std::signal(number, [](int) { stop_requested = 1; }) == SIG_IGN) std::signal(number, SIG_IGN);
  }
  std::signal(SIGPIPE, SIG_IGN);
  options.interrupted = [] { return stop_requested != 0; };
  const auto result = daemon::run_virtual(rig, options);
  std::signal(SIGINT, previous);
  progress.reset();
  const std::string page = o.report ? write_page(o, result) : std::string();
  if (o.json) {
    const auto& rec = result.recorder;
    std::cout << nlohmann::json{{"run", result.run_id},
                                {"directory", result.directory.string()},
                                {"report", page},
                                {"outcome", result.outcome},
                                {"fault", result.fault},
                                {"ticks", result.ticks},
                                {"simulated_s", result.simulated_s},
                                {"wall_s", result.wall_s},
                                {"written_bytes", rec.written_bytes},
                                {"missing_samples", rec.frame_missing + rec.pressure_missing + rec.dropped_records}}
                     .dump(2)
              << '\n';
  } else {
    print_run_result(result);
    if (!page.empty()) std::printf("  to look at: %s\n", page.c_str());
  }
  return exit_code(result);
}

/// What the recording can hold: a signed number of 64 bits, not negative.
std::string why_not_a_seed(const std::string& text) {
  std::int64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error == std::errc() && end == text.data() + text.size() && seed >= 0) return {};
  return "\"" + base::printable(text) + "\" is no seed: a whole number from 0 to " +
         std::to_string(std::numeric_limits<std::int64_t>::max());
}

Command add_run(CLI::App& app) {
  auto* sub = app.add_subcommand("run", "Run a protocol on a simulated rig, in this process and in virtual time");
  auto o = std::make_shared<RunOptions>();
  auto* protocol = sub->add_option("protocol", o->protocol, "Protocol file (TOML)");
  sub->add_option("--rig", o->rig, "The rig's file (config/rigs/)")->required();
  sub->add_option("--specimen", o->specimen, "Specimen file, if not the rig's own");
  sub->add_option("--runs", o->runs, "Where runs and their catalogue are kept")->capture_default_str();
  sub->add_option("--seed", o->seed, "Of the simulated rig's noise, instead of the rig file's")
      ->check([](const std::string& text) { return why_not_a_seed(text); })
      ->each([o](const std::string&) { o->has_seed = true; });
  sub->add_option("--resume", o->resume, "Go on with this interrupted run instead of starting a protocol")
      ->excludes(protocol);
  sub->add_flag("--aborted", o->aborted, "With --resume: although an operator had ended it");
  sub->add_flag("--on-another-rig", o->on_another_rig, "With --resume: although it was recorded on another rig");
  sub->add_flag("--another-specimen", o->another_specimen,
                "With --resume: although it was begun with another specimen");
  sub->add_flag("--json", o->json, "Print the result as JSON");
  sub->add_flag("!--no-report", o->report, "Leave out report.html, the run's page");
  sub->add_flag("--quiet", o->quiet, "No progress");
  return {sub, [o] {
            if (o->protocol.empty() && o->resume.empty()) {
              std::cerr << "isorig run: name a protocol file, or a run to --resume\n";
              return static_cast<int>(kUsage);
            }
            return run(*o);
          }};
}

const Registration kRun(4, add_run);

}  // namespace
}  // namespace isorig::cli
