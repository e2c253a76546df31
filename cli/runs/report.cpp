#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <string_view>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"
#include "cli/runs/run_argument.hpp"
#include "cli/runs/run_report.hpp"
#include "cli/screen/progress.hpp"
#include "identify/report/neighbours.hpp"

/// isorig report: the page of a run, made again or for the first time.
namespace isorig::cli {
namespace {

struct ReportOptions {
  RunArgument run;
  std::string out;
  bool background = false;
};

/// Beside a rig that may be running: behind whatever else wants the processor, the first to go when memory ends, and
/// gone with the daemon that started it. Not SCHED_IDLE: on a busy machine the page would take minutes.
void step_back() {
  const sched_param none{};
  (void)::sched_setscheduler(0, SCHED_BATCH, &none);
  (void)::setpriority(PRIO_PROCESS, 0, 10);  // the daemon's unit may refuse it
  std::ofstream("/proc/self/oom_score_adj") << 500;
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
}

/// A segment, a catalogue or a recording's table: everything but a page made earlier, by whatever link it is named.
bool is_something_else(const std::filesystem::path& file) {
  constexpr std::string_view kPage = "<!DOCTYPE html";
  if (std::error_code error; !std::filesystem::is_regular_file(file, error)) return false;
  std::string begin(kPage.size(), '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  const auto read = static_cast<std::size_t>(in.gcount());
  return read > 0 && begin != kPage;
}

int report(const ReportOptions& options) {
  if (options.background) step_back();
  const auto found = find_run(options.run);
  const auto directory =
      std::filesystem::is_directory(found.directory) ? found.directory : found.directory.parent_path();
  const std::filesystem::path file = options.out.empty() ? directory / kRunReport : std::filesystem::path(options.out);
  if (identify::report::is_page_of_another(file.filename().string(), kRunReport)) {
    std::cerr << file.string() << ": another command calls its page so; name another file with --out\n";
    return kUsage;
  }
  if (!options.out.empty() && is_something_else(file)) {
    std::cerr << file.string() << ": is there already, and is no page; name another file with --out\n";
    return kUsage;
  }
  std::optional<Progress> progress(std::in_place, "report", !options.background);
  write_run_report(found, file, made_by_this_call({{"Run", found.directory.string()}}),
                   [&](double fraction, const char* doing) { progress->at(fraction, doing); });
  progress.reset();
  std::printf("%s\n", base::printable(file.string()).c_str());
  return kOk;
}

Command add_report(CLI::App& app) {
  auto options = std::make_shared<ReportOptions>();
  auto* sub = app.add_subcommand("report", "Write a run's page: who, what, how well, what happened, its curves");
  options->run.add_to(*sub);
  sub->add_option("--out", options->out, "The page's file; without it, report.html in the run's folder");
  sub->add_flag("--background", options->background,
                "With low priority, beside a rig that runs (the daemon's own calls)");
  return {sub, [options] { return report(*options); }};
}

const Registration kReport(37, add_report);

}  // namespace
}  // namespace isorig::cli
