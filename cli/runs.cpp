#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/run_argument.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/run_directory.hpp"
#include "messages/run_log.hpp"

/// isorig runs: what there is.
namespace isorig::cli {

FoundRun find_run(const RunArgument& argument) {
  const std::filesystem::path as_path(argument.run);
  if (!messages::list_segments(as_path).empty()) {
    const auto whole = std::filesystem::weakly_canonical(as_path);
    FoundRun found{whole.filename().string(), whole, {}, daemon::RunLock::is_held(whole)};
    if (!std::filesystem::is_directory(whole)) return found;
    try {  // what its catalogue knows, if it lies in one
      const daemon::Catalogue catalogue(whole.parent_path(), daemon::Catalogue::Access::kReadOnly);
      if (auto row = catalogue.find_run(found.id); row && row->id == found.id) found.row = std::move(row);
    } catch (const std::exception&) {
    }
    return found;
  }
  if (std::filesystem::exists(as_path) || as_path.has_parent_path()) {
    throw std::runtime_error(argument.run +
                             " holds no recording (no segment-0001.lcm); `isorig runs` lists what there is");
  }
  const daemon::Catalogue catalogue(argument.runs, daemon::Catalogue::Access::kReadOnly);
  auto row = catalogue.find_run(argument.run);
  if (!row) {
    throw std::runtime_error("there is no run \"" + argument.run + "\" in " + argument.runs +
                             "; `isorig runs` lists them, --runs names another place");
  }
  const auto id = row->id;
  const auto directory = row->directory;
  return {id, directory, std::move(row), daemon::RunLock::is_held(directory)};
}

namespace {

struct Options {
  std::string runs = daemon::default_catalogue().string();
  bool json = false;
};

int list(const Options& options) {
  const daemon::Catalogue catalogue(options.runs, daemon::Catalogue::Access::kReadOnly);
  const auto rows = catalogue.runs();
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const auto& r : rows) {
      out.push_back({{"id", r.id},
                     {"started_utc", r.started_utc},
                     {"state", r.state},
                     {"fault", r.fault},
                     {"specimen", r.specimen},
                     {"rig", r.rig},
                     {"protocol", r.protocol},
                     {"operator", r.operator_name},
                     {"attempts", r.attempts},
                     {"sessions", r.sessions},
                     {"sessions_done", r.sessions_done},
                     {"directory", r.directory.string()}});
    }
    std::cout << out.dump(2) << '\n';
    return kOk;
  }
  if (rows.empty()) {
    std::cout << "no runs yet in " << base::printable(options.runs) << '\n';
    return kOk;
  }
  std::size_t width = 3;
  for (const auto& r : rows) width = std::max(width, r.id.size());
  std::printf("%-*s  %-20s  %-11s  %8s  %s\n", static_cast<int>(width), "run", "started", "state", "sessions",
              "specimen");
  for (const auto& r : rows) {
    using base::printable;
    std::printf("%-*s  %-20s  %-11s  %4d/%-3d  %s\n", static_cast<int>(width), printable(r.id).c_str(),
                printable(r.started_utc).c_str(), printable(r.state).c_str(), r.sessions_done, r.sessions,
                printable(r.specimen).c_str());
    if (!r.fault.empty()) std::printf("%-*s  %s\n", static_cast<int>(width), "", printable(r.fault).c_str());
  }
  return kOk;
}

Command add_runs(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("runs", "List the runs of the catalogue, newest first");
  sub->add_option("--runs", options->runs, "Where runs and their catalogue are kept")->capture_default_str();
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return list(*options); }};
}

const Registration kRuns(30, add_runs);

}  // namespace
}  // namespace isorig::cli
