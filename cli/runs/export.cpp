#include "daemon/export/export.hpp"

#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/runs/noted_specimen.hpp"
#include "cli/runs/run_argument.hpp"
#include "cli/screen/progress.hpp"

/// isorig export: a run in the files of other tools.
namespace isorig::cli {
namespace {

struct ExportCommandOptions {
  RunArgument run;
  std::string out;
  std::string format = "csv";
  std::string specimen;
  double rest_length_mm = 0.0;
  bool remap = false;
  bool json = false;
};

void print_json(const daemon::ExportReport& report) {
  nlohmann::ordered_json out{{"state", report.read.state_text()},
                             {"whole", report.read.state() == messages::RecordingState::kWhole},
                             {"checksums", report.read.has_checksums},
                             {"complaints", report.read.complaints()},
                             {"notes", report.read.notes}};
  out["recordings"] = nlohmann::ordered_json::array();
  for (const auto& s : report.sessions) {
    out["recordings"].push_back({{"folder", s.folder.string()},
                                 {"name", s.name},
                                 {"session", s.session},
                                 {"attempt", s.attempt},
                                 {"repetition", s.repetition},
                                 {"pressure_psi", s.pressure_psi},
                                 {"complete", s.complete},
                                 {"frame_rows", s.frame_rows},
                                 {"pressure_rows", s.pressure_rows},
                                 {"not_measured", s.not_measured},
                                 {"not_increasing", s.not_increasing},
                                 {"remap_rms_us", s.remap_rms_us},
                                 {"kept_online", s.kept_online},
                                 {"clock_breaks", s.clock_breaks}});
    auto& replaces = out["recordings"].back()["replaces"] = nlohmann::ordered_json::array();
    for (const auto& path : s.replaces) replaces.push_back(path.string());
  }
  out["skipped"] = nlohmann::ordered_json::array();
  for (const auto& s : report.skipped) {
    out["skipped"].push_back({{"name", s.name}, {"session", s.session}, {"pressure_rows", s.pressure_rows}});
  }
  std::cout << out.dump(2) << '\n';
}

void print_text(const daemon::ExportReport& report, bool remap) {
  for (const auto& s : report.sessions) {
    std::printf("%s: %zu rows of frame, %zu of pressure%s", base::printable(s.folder.string()).c_str(), s.frame_rows,
                s.pressure_rows, s.complete ? "" : "; NOT complete");
    if (s.not_measured > 0) std::printf("; %zu stale or faulty pressure samples left out", s.not_measured);
    if (s.not_increasing > 0)
      std::printf("; %zu rows had the time of the row before, and follow it by 2 ns", s.not_increasing);
    if (remap) std::printf("; times moved by %.1f us rms", s.remap_rms_us);
    if (s.kept_online > 0) std::printf("; %zu rows keep their online time", s.kept_online);
    for (const auto& path : s.replaces) {
      std::printf("; replaces %s", base::printable(path.filename().string()).c_str());
    }
    std::printf("\n");
  }
}

int run_export(const ExportCommandOptions& options) {
  if (options.format == "parquet") {
    std::cerr
        << "isorig export: this isorig writes no Parquet (Debian 12 has no Arrow to build it with); --format hdf5 "
           "holds the same tables\n";
    return kUsage;
  }
  const auto found = find_run(options.run);
  daemon::ExportOptions how;
  how.remap = options.remap;
  how.format = options.format == "hdf5"  ? daemon::ExportFormat::kHdf5
               : options.format == "mat" ? daemon::ExportFormat::kMat
                                         : daemon::ExportFormat::kCsv;
  how.specimen = options.specimen;
  how.rest_length_mm = options.rest_length_mm;
  how.run_id = found.id;
  how.run_directory = std::filesystem::weakly_canonical(found.directory);
  how.still_written = found.still_written;
  if (found.row) {
    how.operator_name = found.row->operator_name;
    how.outcome = found.row->state;
  }
  std::string noted_words;
  how.noted = noted_specimen(found.directory, noted_words);
  if (how.noted) std::cerr << "isorig export: " << noted_words << '\n';
  std::optional<Progress> progress(std::in_place, "export");
  how.on_progress = [&](double fraction) { progress->at(fraction); };
  const auto report = daemon::export_run(found.directory, options.out, how);
  progress.reset();
  if (options.json) {
    print_json(report);
  } else {
    print_text(report, options.remap);
  }
  const bool whole = report.read.state() == messages::RecordingState::kWhole;
  if (!whole) std::cerr << "isorig export: the recording is " << messages::to_text(report.read.state()) << '\n';
  for (const auto& line : report.read.complaints()) std::cerr << "isorig export: " << base::printable(line) << '\n';
  if (report.read.has_header && !report.read.has_checksums) {
    std::cerr
        << "isorig export: the recording has no checksums (an older isorig made it): altered values would not show\n";
  }
  for (const auto& s : report.skipped) std::cerr << "isorig export: " << base::printable(s.why) << '\n';
  if (report.sessions.empty()) {
    std::cerr << "isorig export: run " << found.id
              << (report.skipped.empty() ? " holds no samples of any session\n"
                                         : " holds no samples of the frame: nothing was exported\n");
    return kFailure;
  }
  std::size_t kept = 0;
  for (const auto& s : report.sessions) kept += s.kept_online;
  if (kept > 0) {
    std::cerr << "isorig export: " << kept
              << " rows keep the time that the daemon stamped: mapping them again would not be "
              << "better (a device's clock began anew or stepped there, or exchanges are missing)\n";
  }
  return whole && kept == 0 && report.skipped.empty() ? kOk : kDataLost;
}

Command add_export(CLI::App& app) {
  auto options = std::make_shared<ExportCommandOptions>();
  auto* sub = app.add_subcommand("export", "Write a run for other tools: in the recording format, as HDF5 or as MAT");
  options->run.add_to(*sub);
  sub->add_option("--out", options->out, "Folder that it goes to; made if needed")->required();
  sub->add_option("--format", options->format,
                  "csv: the recording format, a folder each; hdf5: one file; mat: for MATLAB and Octave, a file each")
      ->check(CLI::IsMember({"csv", "hdf5", "mat", "parquet"}))
      ->capture_default_str();
  sub->add_option("--specimen", options->specimen,
                  "Its name, where the log has none (lcm-logger's of the live channels)");
  sub->add_option("--rest-length-mm", options->rest_length_mm, "Its unpressurized length, where the log has none")
      ->check(within(1e-3, 1e4));
  sub->add_flag("--remap", options->remap,
                "Map device times again, with the exchanges before and after each sample (closer than online)");
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return run_export(*options); }};
}

const Registration kExport(35, add_export);

}  // namespace
}  // namespace isorig::cli
