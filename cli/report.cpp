#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <memory>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"
#include "cli/run_argument.hpp"
#include "cli/run_report.hpp"

/// isorig report: the page of a run, made again or for the first time.
namespace isorig::cli {
namespace {

struct Options {
  RunArgument run;
  std::string out;
  bool idle = false;
};

/// Beside a rig that may be running: only what nobody else wants of the processor, and the first to go when memory
/// ends.
void step_back() {
  [[maybe_unused]] const int ignored = ::setpriority(PRIO_PROCESS, 0, 19);
  std::ofstream("/proc/self/oom_score_adj") << 500;
}

int report(const Options& options) {
  if (options.idle) step_back();
  const auto found = find_run(options.run);
  const auto directory =
      std::filesystem::is_directory(found.directory) ? found.directory : found.directory.parent_path();
  const std::filesystem::path file = options.out.empty() ? directory / kRunReport : std::filesystem::path(options.out);
  write_run_report(found, file, made_by_this_call({{"Run", found.directory.string()}}));
  std::printf("%s\n", base::printable(file.string()).c_str());
  return kOk;
}

Command add_report(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("report", "Write a run's page: who, what, how well, what happened, its curves");
  options->run.add_to(*sub);
  sub->add_option("--out", options->out, "The page's file; without it, report.html in the run's folder");
  sub->add_flag("--idle", options->idle, "With the least priority, beside a rig that runs (the daemon's own calls)");
  return {sub, [options] { return report(*options); }};
}

const Registration kReport(30, add_report);

}  // namespace
}  // namespace isorig::cli
