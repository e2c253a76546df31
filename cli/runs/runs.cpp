#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "cli/command.hpp"
#include "cli/runs/run_argument.hpp"
#include "cli/screen/duration.hpp"
#include "cli/screen/view.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/recording/run_row_json.hpp"
#include "messages/log_event.hpp"
#include "messages/run_log.hpp"

/// isorig runs: what there is.
namespace isorig::cli {

namespace {

/// A person may name any file. One that is empty, or cut, is a log that was lost; one that has none of a log's marks
/// never was one.
void refuse_what_is_no_log(const std::filesystem::path& file) {
  std::string sync_word;
  for (const int shift : {24, 16, 8, 0}) sync_word += static_cast<char>(messages::kLogSyncWord >> shift);  // big endian
  constexpr std::size_t kLookedAt = std::size_t{1} << 20U;
  if (!std::filesystem::is_regular_file(file)) return;
  const auto begin = base::read_text_file(file, kLookedAt);
  if (begin.empty() || sync_word.starts_with(begin) || begin.find(sync_word) != std::string::npos) return;
  throw base::ConfigError({{file.string(), 0, 0,
                            "is no LCM log: none of its first bytes begins a message; name a run (`isorig runs`), its "
                            "folder, or a log"}});
}

}  // namespace

FoundRun find_run(const RunArgument& argument) {
  const std::filesystem::path as_path(argument.run);
  refuse_what_is_no_log(as_path);
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

struct RunsOptions {
  std::string runs = daemon::default_catalogue().string();
  bool json = false;
};

/// Each column as wide as what stands in it; on a terminal no wider than that.
void print_table(const std::vector<daemon::RunRow>& rows) {
  using base::printable;
  std::vector<std::vector<std::string>> cells{
      {"run", "outcome", "recorded", "sessions", "operator", "protocol", "specimen", "started"}};
  for (const auto& r : rows) {
    cells.push_back({printable(r.id), printable(r.state), duration_text(r.recorded_s),
                     std::to_string(r.sessions_done) + "/" + std::to_string(r.sessions),
                     r.operator_name.empty() ? "-" : printable(r.operator_name),
                     printable(std::filesystem::path(r.protocol).stem().string()), printable(r.specimen),
                     printable(r.started_utc)});
  }
  std::vector<std::size_t> width(cells.front().size());
  for (const auto& row : cells) {
    for (std::size_t i = 0; i < row.size(); ++i) width[i] = std::max(width[i], row[i].size());
  }
  const int columns = ::isatty(STDOUT_FILENO) != 0 ? terminal_size(STDOUT_FILENO).columns : 1 << 20;
  for (std::size_t k = 0; k < cells.size(); ++k) {
    std::string line;
    for (std::size_t i = 0; i < cells[k].size(); ++i) {
      line += cells[k][i];
      if (i + 1 < cells[k].size()) line += std::string(width[i] - cells[k][i].size() + 2, ' ');
    }
    std::cout << cut(line, columns) << '\n';
    if (k > 0 && !rows[k - 1].fault.empty()) {
      const char* was = rows[k - 1].state == "done" ? "a fault on the way: " : "";
      std::cout << cut(std::string(width[0] + 2, ' ') + was + printable(rows[k - 1].fault), columns) << '\n';
    }
  }
}

int list(const RunsOptions& options) {
  const daemon::Catalogue catalogue(options.runs, daemon::Catalogue::Access::kReadOnly);
  const auto rows = catalogue.runs();
  if (options.json) {
    auto out = nlohmann::ordered_json::array();
    for (const auto& r : rows) out.push_back(daemon::row_json(r));
    std::cout << out.dump(2) << '\n';
    return kOk;
  }
  if (rows.empty()) {
    std::cout << "no runs yet in " << base::printable(options.runs) << '\n';
    return kOk;
  }
  print_table(rows);
  return kOk;
}

Command add_runs(CLI::App& app) {
  auto options = std::make_shared<RunsOptions>();
  auto* sub = app.add_subcommand("runs", "List the runs of the catalogue, newest first");
  sub->add_option("--runs", options->runs, "Where runs and their catalogue are kept")->capture_default_str();
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return list(*options); }};
}

const Registration kRuns(38, add_runs);

}  // namespace
}  // namespace isorig::cli
