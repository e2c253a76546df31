#include "identify/fv/align.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/lock_file.hpp"
#include "base/printable.hpp"
#include "base/whole_file.hpp"
#include "cli/command.hpp"
#include "cli/runs/overwriting.hpp"
#include "cli/screen/progress.hpp"
#include "messages/csv.hpp"
#include "messages/further_columns.hpp"

namespace isorig::cli {
namespace {

struct AlignCommandOptions {
  std::string frame;
  std::string pressure;
  std::string out;
  std::string toml;
  bool replace = false;
};

std::string json_of(const identify::AlignResult& result) {
  nlohmann::ordered_json document = {{"format", "isorig-align/1"}, {"aligned", result.aligned}};
  if (!result.aligned) {
    document["refusal"] = result.refusal;
    return document.dump(1) + "\n";
  }
  const auto& a = result.alignment;
  auto events = nlohmann::ordered_json::array();
  for (const auto& e : a.events)
    events.push_back({{"t_frame_s", e.t_frame_s}, {"shift_s", e.shift_s.value}, {"se", e.shift_s.standard_error}});
  document["mapping"] = "t_frame = reference + offset + (1 + skew) * (t_pressure - reference)";
  document["reference_s"] = a.reference_s;
  document["offset_s"] = {{"value", a.offset_s.value}, {"se", a.offset_s.standard_error}};
  document["skew"] = {{"value", a.skew.value}, {"se", a.skew.standard_error}, {"known", a.skew_known}};
  document["worst_error_s"] = a.worst_error_s;
  document["response_psi_mm"] = a.response;
  document["recovery_per_s"] = a.recovery_per_s;
  document["significance"] = a.significance;
  document["events"] = events;
  return document.dump(1) + "\n";
}

bool is_there(const std::filesystem::path& file) {
  std::error_code error;
  return std::filesystem::exists(std::filesystem::symlink_status(file, error));
}

/// Before the minutes that long streams take, not after. "" where the folder may be written.
std::string why_not_to_write(const AlignCommandOptions& options) {
  constexpr std::array<std::string_view, 4> kNames{"recording.toml", "frame.csv", "pressure.csv", "align.json"};
  const std::filesystem::path out = options.out;
  std::vector<std::string> tables;
  for (const auto table : messages::kRecordingTables) tables.push_back(std::string(table) + ".csv");
  const std::vector<std::string_view> also(tables.begin(), tables.end());
  std::vector<std::filesystem::path> read{options.frame, options.pressure};
  if (!options.toml.empty()) read.emplace_back(options.toml);
  Overwriting what{.names = kNames, .also = also, .read = read, .replace = true};
  if (auto why = why_not_to_overwrite(out, what); !why.empty()) return why;
  // Whatever is said of replacing: its specimen and its run would stand beside the streams of another.
  if (options.toml.empty() && is_there(out / "recording.toml"))
    return options.out +
           ": a recording is there already, and its recording.toml would be taken for that of these streams; name "
           "another folder with --out, or say with --toml what they are of";
  what.replace = options.replace;
  return why_not_to_overwrite(out, what);
}

/// align.json says that the rest is aligned: the old one goes before, the new one comes last.
void put_alignment_round(const std::filesystem::path& out, const std::string& alignment,
                         const std::function<void()>& put_rest) {
  base::WholeFiles file;
  file.add(out / "align.json", alignment);
  std::error_code ignored;
  std::filesystem::remove(out / "align.json", ignored);
  put_rest();
  file.put();
}

/// The streams alone: a recording needs a specimen, which only --toml can say.
void write_streams(const AlignCommandOptions& options, const messages::PressureSamples& pressure,
                   const messages::FurtherColumns& further, const std::string& alignment) {
  const std::filesystem::path out = options.out;
  const std::array<messages::CsvColumnView, 2> columns{
      {{"t_s", pressure.t_s}, {"pressure_psi", pressure.pressure_psi}}};
  base::WholeFiles files;
  files.add(out / "frame.csv", messages::read_whole_file(options.frame));
  files.add(out / "pressure.csv", messages::with_further_columns(messages::number_csv_text(columns), further.pressure));
  put_alignment_round(out, alignment, [&] { files.put(); });
}

int align(const AlignCommandOptions& options) {
  if (const auto why = why_not_to_write(options); !why.empty()) {
    std::cerr << base::printable_lines(why) << '\n';
    return kBadInput;
  }
  messages::FrameSamples frame;
  messages::PressureSamples pressure;
  messages::FurtherColumns further;
  std::optional<Progress> progress(std::in_place, "align");
  try {
    progress->at(0.0, "reading");
    frame = messages::read_frame_csv(options.frame);
    pressure = messages::read_pressure_csv(options.pressure);
    further = {messages::read_further_columns(options.frame, messages::kFrameColumns),
               messages::read_further_columns(options.pressure, messages::kPressureColumns)};
  } catch (const messages::RecordingError& e) {
    progress.reset();
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  messages::Recording recording;
  if (!options.toml.empty()) {
    try {
      recording.metadata = messages::read_recording_toml(options.toml);
    } catch (const messages::RecordingError& e) {
      progress.reset();
      std::cerr << e.what() << '\n';
      return kBadInput;
    }
  }
  // Shares of the time that long streams take.
  constexpr double kRead = 0.2, kSearched = 0.95;
  identify::AlignOptions how;
  how.on_progress = [&](double done) {
    progress->at(kRead + (kSearched - kRead) * done, "finding the strokes in both");
  };
  const auto result = identify::align(frame, pressure, how);
  progress->at(kSearched, "writing");
  const std::filesystem::path out = options.out;
  const base::FolderLock alone(out);
  if (!result.aligned) {
    progress.reset();
    std::printf("%s\n", result.refusal.c_str());
    // Beside streams that an earlier call aligned it would say of them that they are not.
    if (is_there(out / "frame.csv") || is_there(out / "pressure.csv"))
      std::printf("nothing in %s was replaced\n", options.out.c_str());
    else
      base::write_whole_file(out / "align.json", json_of(result));
    return kFailure;
  }
  const auto& a = result.alignment;
  for (double& t : pressure.t_s) t = a.frame_time_s(t);
  std::optional<messages::Replaced> replaced;
  if (options.toml.empty()) {
    write_streams(options, pressure, further, json_of(result));
  } else {
    recording.frame = std::move(frame);
    recording.pressure = std::move(pressure);
    put_alignment_round(out, json_of(result), [&] { replaced = messages::write_recording(out, recording, further); });
  }
  progress.reset();
  std::printf("aligned by %zu strokes: offset %.4f +- %.4f s at t = %.1f s, skew ", a.events.size(), a.offset_s.value,
              a.offset_s.standard_error, a.reference_s);
  if (a.skew_known)
    std::printf("%.1f +- %.1f ppm", 1e6 * a.skew.value, 1e6 * a.skew.standard_error);
  else
    std::printf("not known (taken as 0 +- %.0f ppm: too few strokes)", 1e6 * a.skew.standard_error);
  std::printf("; worst error in the record %.4f s (1 sigma)\nwritten to %s\n", a.worst_error_s, options.out.c_str());
  if (replaced)
    for (const auto& line : said_of(*replaced)) std::printf("%s\n", base::printable_lines(line).c_str());
  return kOk;
}

Command add_align(CLI::App& app) {
  auto options = std::make_shared<AlignCommandOptions>();
  auto* sub = app.add_subcommand("align", "Put two separately recorded streams on one clock by the strokes in both");
  sub->add_option("FRAME", options->frame, "CSV: t_s,position_mm,force_N")->required();
  sub->add_option("PRESSURE", options->pressure, "CSV: t_s,pressure_psi, on a clock of its own")->required();
  sub->add_option("--out", options->out, "Folder for frame.csv, pressure.csv (on the frame's clock) and align.json")
      ->required();
  sub->add_option("--toml", options->toml, "recording.toml to make a whole recording of them");
  sub->add_flag("--replace", options->replace, "Replace what is there already");
  return {sub, [options] { return align(*options); }};
}

const Registration kAlign(34, add_align);

}  // namespace
}  // namespace isorig::cli
