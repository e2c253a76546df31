#include <cstdio>
#include <iostream>
#include <memory>
#include <vector>

#include "cli/command.hpp"
#include "identify/diagnose/drive.hpp"
#include "messages/csv.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"

namespace isorig::cli {
namespace {

struct Options {
  std::string recording;
  std::string model;
  std::string out;
};

int predict(const Options& options) {
  const model::ModelSpec spec = model::read_model(options.model);
  messages::Recording recording;
  try {
    recording = messages::read_recording(options.recording);
  } catch (const messages::RecordingError& e) {
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  // What was measured is out of reach from here on: a prediction that had seen it would prove nothing.
  std::fill(recording.frame.force_N.begin(), recording.frame.force_N.end(), 0.0);
  const identify::Drive drive = identify::reconstruct_drive(recording);
  model::RunningModel running(spec, drive.reference);
  running.reset(drive.instants.front());
  std::vector<double> force_N;
  force_N.reserve(drive.instants.size());
  for (const model::Instant& now : drive.instants) force_N.push_back(running.step(now));

  const messages::CsvColumnView columns[] = {{"t_s", recording.frame.t_s}, {"force_N", force_N}};
  const std::string text = messages::number_csv_text(columns);
  std::FILE* file = std::fopen(options.out.c_str(), "wb");
  const bool written = file != nullptr && std::fwrite(text.data(), 1, text.size(), file) == text.size();
  if (file == nullptr || std::fclose(file) != 0 || !written) {
    std::cerr << options.out << ": cannot be written\n";
    return kFailure;
  }
  return kOk;
}

Command add_predict(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand(
      "predict",
      "Simulate a model on a recording's position and pressure; its measured force is not looked at");
  sub->add_option("RECORDING", options->recording, "Folder of the recording")->required();
  sub->add_option("--model", options->model, "Model (model.toml or nominal.toml of a diagnosis)")->required();
  sub->add_option("--out", options->out, "CSV to write: t_s,force_N, one row per row of frame.csv")
      ->required();
  return {sub, [options] { return predict(*options); }};
}

const Registration kPredict(30, add_predict);

}  // namespace
}  // namespace isorig::cli
