#include "identify/fv/align.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/whole_file.hpp"
#include "cli/command.hpp"
#include "cli/screen/progress.hpp"
#include "identify/report/page.hpp"
#include "messages/further_columns.hpp"

namespace isorig::cli {
namespace {

struct AlignCommandOptions {
  std::string frame;
  std::string pressure;
  std::string out;
  std::string toml;
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

int align(const AlignCommandOptions& options) {
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
  std::filesystem::create_directories(options.out);
  base::write_whole_file(std::filesystem::path(options.out) / "align.json", json_of(result));
  if (!result.aligned) {
    progress.reset();
    std::printf("%s\n", result.refusal.c_str());
    return kFailure;
  }
  const auto& a = result.alignment;
  for (double& t : pressure.t_s) t = a.frame_time_s(t);
  recording.frame = std::move(frame);
  recording.pressure = std::move(pressure);
  if (options.toml.empty()) {
    // The streams alone: a recording needs a specimen and a rest length, which only --toml can say.
    std::filesystem::copy_file(options.frame, std::filesystem::path(options.out) / "frame.csv",
                               std::filesystem::copy_options::overwrite_existing);
    std::string text = "t_s,pressure_psi\n";
    char line[80];
    for (std::size_t i = 0; i < recording.pressure->size(); ++i) {
      std::snprintf(line, sizeof line, "%.6f,%.9g\n", recording.pressure->t_s[i], recording.pressure->pressure_psi[i]);
      text += line;
    }
    base::write_whole_file(std::filesystem::path(options.out) / "pressure.csv",
                           messages::with_further_columns(text, further.pressure));
  } else {
    messages::write_recording(options.out, recording, further);
  }
  progress.reset();
  std::printf("aligned by %zu strokes: offset %.4f +- %.4f s at t = %.1f s, skew ", a.events.size(), a.offset_s.value,
              a.offset_s.standard_error, a.reference_s);
  if (a.skew_known)
    std::printf("%.1f +- %.1f ppm", 1e6 * a.skew.value, 1e6 * a.skew.standard_error);
  else
    std::printf("not known (taken as 0 +- %.0f ppm: too few strokes)", 1e6 * a.skew.standard_error);
  std::printf("; worst error in the record %.4f s (1 sigma)\nwritten to %s\n", a.worst_error_s, options.out.c_str());
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
  return {sub, [options] { return align(*options); }};
}

const Registration kAlign(34, add_align);

}  // namespace
}  // namespace isorig::cli
