#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

#include "base/whole_file.hpp"
#include "cli/analysis/answers.hpp"
#include "cli/command.hpp"
#include "cli/screen/progress.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/motion/reconstruction.hpp"
#include "identify/diagnose/prepare.hpp"
#include "identify/response/response_model.hpp"
#include "messages/csv.hpp"
#include "messages/recording.hpp"
#include "messages/recording_id.hpp"
#include "model/composed.hpp"

namespace isorig::cli {
namespace {

struct PredictOptions {
  std::string recording;
  std::string model;
  std::string out;
};

/// A prediction that took the place of what was measured could not be told from it any more: no file of this recording
/// or of another, by whatever link it is named.
bool is_of_a_recording(const std::filesystem::path& out) {
  std::error_code error;
  const std::filesystem::path file = std::filesystem::weakly_canonical(out, error);
  if (error || !std::filesystem::exists(file.parent_path() / "recording.toml", error)) return false;
  return file.filename() == "frame.csv" || file.filename() == "pressure.csv" || file.filename() == "recording.toml";
}

/// Written aside and renamed: what stands at `out` is a whole prediction or what stood there before.
bool write_whole(const std::filesystem::path& out, const std::string& text) {
  std::error_code error;
  const auto complain = [&](const std::string& why) {
    std::cerr << out.string() << ": cannot be written: " << why << '\n';
    return false;
  };
  const std::filesystem::path folder = std::filesystem::absolute(out).parent_path();
  if (!std::filesystem::is_directory(folder, error))
    return complain("there is no folder " + folder.string() + "; make it first");
  if (std::filesystem::is_directory(out, error)) return complain("it is a folder; name a file with --out");
  // A pipe or a terminal has no place to be renamed to, and a link (/dev/stdout) is not to be replaced.
  const auto kind = std::filesystem::symlink_status(out, error).type();
  if (kind == std::filesystem::file_type::not_found || kind == std::filesystem::file_type::regular) {
    try {
      base::write_whole_file(out, text);
      return true;
    } catch (const std::runtime_error& e) {
      std::cerr << e.what() << '\n';
      return false;
    }
  }
  std::FILE* file = std::fopen(out.c_str(), "wb");
  if (file == nullptr) return complain(std::strerror(errno));
  const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size();
  return std::fclose(file) != 0 || !written ? complain(std::strerror(errno)) : true;
}

int predict(const PredictOptions& options) {
  if (is_of_a_recording(options.out)) {
    std::cerr << options.out << ": is part of a recording; name another file with --out\n";
    return kFailure;
  }
  if (std::error_code error; std::filesystem::equivalent(options.out, options.model, error)) {
    std::cerr << options.out << ": is the model itself; name another file with --out\n";
    return kFailure;
  }
  const bool answers = identify::response::is_response_model(options.model);
  const model::ModelSpec spec = answers ? model::ModelSpec{} : model::read_model(options.model);
  if (const std::string why = identify::unfit_seen(spec); !why.empty()) {
    std::cerr << options.model << ": " << why << '\n';
    return kBadInput;
  }
  // Shares of the time that a recording of hours takes.
  constexpr double kRead = 0.08, kMotion = 0.85, kSimulated = 0.97;
  std::optional<Progress> progress(std::in_place, "predict");
  progress->at(0.0, "reading");
  messages::Recording recording;
  try {
    recording = messages::read_recording_of_any_output(options.recording);
  } catch (const messages::RecordingError& e) {
    progress.reset();
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  if (recording.metadata.output != messages::Output::kForce) {
    try {
      const std::string text = predicted_answer(recording, options.recording, options.model);
      progress.reset();
      return write_whole(options.out, text) ? kOk : kFailure;
    } catch (const std::invalid_argument& e) {
      progress.reset();
      std::cerr << e.what() << '\n';
      return kBadInput;
    }
  }
  if (answers) {
    progress.reset();
    std::cerr << options.model << ": describes a position or a pressure, and the output of " << options.recording
              << " is the force; give model.toml of a diagnosis of forces\n";
    return kBadInput;
  }
  // By this number, made of all readings, a model knows the recording whose slips it holds.
  const double recording_id = messages::recording_id(recording);
  // What was measured is out of reach from here on: a prediction that had seen it would prove nothing.
  std::fill(recording.frame.force_N.begin(), recording.frame.force_N.end(), 0.0);
  const auto finding = [&](double done) { progress->at(kRead + (kMotion - kRead) * done, "finding the motion"); };
  finding(0.0);
  const identify::RecordingQuality quality = identify::recording_quality(recording);
  identify::Excitation excitation = identify::reconstruct_excitation(recording, quality, finding);
  excitation.reference.recording_id = recording_id;
  identify::count_as_fitted(excitation, recording, quality, spec);
  const identify::Forecast forecast = identify::forecast(
      spec, excitation, [&](double done) { progress->at(kMotion + (kSimulated - kMotion) * done, "simulating"); },
      identify::unread_by(spec, recording));
  progress->at(kSimulated, "writing");
  std::vector<messages::CsvColumnView> columns{{"t_s", recording.frame.t_s}, {"force_N", forecast.force_N}};
  if (spec.seen)
    columns.insert(columns.end(),
                   {{"low95_N", forecast.low95_N}, {"high95_N", forecast.high95_N}, {"outside", forecast.outside}});
  const std::string text = messages::number_csv_text(columns);
  progress.reset();
  for (const std::string& note : forecast.notes) std::cerr << "note: " << note << '\n';
  return write_whole(options.out, text) ? kOk : kFailure;
}

Command add_predict(CLI::App& app) {
  auto options = std::make_shared<PredictOptions>();
  auto* sub = app.add_subcommand(
      "predict", "Simulate a model on a recording's position and pressure; its measured force is not looked at");
  sub->add_option("RECORDING", options->recording, "Folder of the recording")->required();
  sub->add_option("--model", options->model, "Model (model.toml or nominal.toml of a diagnosis)")->required();
  sub->add_option("--out", options->out, "CSV to write: t_s,force_N and the band, one row per row of frame.csv")
      ->required();
  return {sub, [options] { return predict(*options); }};
}

const Registration kPredict(33, add_predict);

}  // namespace
}  // namespace isorig::cli
