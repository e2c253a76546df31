#include "daemon/export.hpp"

#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/command.hpp"
#include "cli/run_argument.hpp"

/// isorig export: a run as folders in the recording format.
namespace isorig::cli {
namespace {

struct Options {
  RunArgument run;
  std::string out;
  bool remap = false;
  bool json = false;
};

void print_json(const daemon::ExportReport& report) {
  nlohmann::ordered_json out{{"whole", report.read.whole()}, {"complaints", report.read.complaints()}};
  out["recordings"] = nlohmann::ordered_json::array();
  for (const auto& s : report.sessions) {
    out["recordings"].push_back({{"folder", s.folder.string()},
                                 {"session", s.session},
                                 {"attempt", s.attempt},
                                 {"repetition", s.repetition},
                                 {"pressure_psi", s.pressure_psi},
                                 {"complete", s.complete},
                                 {"frame_rows", s.frame_rows},
                                 {"pressure_rows", s.pressure_rows},
                                 {"not_measured", s.not_measured},
                                 {"not_increasing", s.not_increasing},
                                 {"remap_rms_us", s.remap_rms_us}});
  }
  std::cout << out.dump(2) << '\n';
}

void print_text(const daemon::ExportReport& report, bool remap) {
  for (const auto& s : report.sessions) {
    std::printf("%s: %zu rows of frame, %zu of pressure%s", s.folder.c_str(), s.frame_rows, s.pressure_rows,
                s.complete ? "" : "; NOT complete");
    if (s.not_measured > 0) std::printf("; %zu stale or faulty pressure samples left out", s.not_measured);
    if (s.not_increasing > 0) std::printf("; %zu rows out of order left out", s.not_increasing);
    if (remap) std::printf("; times moved by %.1f us rms", s.remap_rms_us);
    std::printf("\n");
  }
}

int run_export(const Options& options) {
  const auto found = find_run(options.run);
  const auto report = daemon::export_run(found.directory, options.out, {options.remap, found.id});
  if (options.json) {
    print_json(report);
  } else {
    print_text(report, options.remap);
  }
  for (const auto& line : report.read.complaints()) std::cerr << "isorig export: " << line << '\n';
  if (report.sessions.empty()) {
    std::cerr << "isorig export: run " << found.id << " holds no samples of any session\n";
    return kFailure;
  }
  return report.read.whole() ? kOk : kDataLost;
}

Command add_export(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("export",
                                 "Write a run in the recording format, a folder per repetition and pressure");
  options->run.add_to(*sub);
  sub->add_option("--out", options->out, "Where the folders go; made if needed")->required();
  sub->add_flag(
      "--remap", options->remap,
      "Map device times again, with the exchanges before and after each sample (closer than online)");
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return run_export(*options); }};
}

const Registration kExport(30, add_export);

}  // namespace
}  // namespace isorig::cli
