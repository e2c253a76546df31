#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>

#include "daemon/host/paths.hpp"
#include "daemon/recording/catalogue.hpp"

namespace isorig::cli {

/// How `show` and `export` are told which run: its name in the catalogue (or the beginning of it, or
/// "latest"), or its directory, or one segment of it, which need no catalogue.
struct RunArgument {
  std::string run;
  std::string runs = daemon::default_catalogue().string();

  void add_to(CLI::App& sub) {
    sub.add_option("RUN", run,
                   "Name of a run, the beginning of it, \"latest\", a run's directory, or one segment of it")
        ->required();
    sub.add_option("--runs", runs, "Where runs and their catalogue are kept")->capture_default_str();
  }
};

struct FoundRun {
  std::string id;
  std::filesystem::path directory;    ///< or the segment
  std::optional<daemon::RunRow> row;  ///< where a catalogue has it
  bool still_written = false;
};

/// Throws std::runtime_error that says what to do when there is no such run.
[[nodiscard]] FoundRun find_run(const RunArgument& argument);

}  // namespace isorig::cli
