#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <thread>

#include "cli/command.hpp"
#include "cli/protocol_input.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/report.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"

namespace isorig::cli {
namespace {

struct Options {
  std::vector<std::string> recordings;
  std::string model;
  std::string out, rig;
  unsigned threads = 2;
  bool report = true;
};

bool write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  stream.flush();
  if (!stream) std::cerr << file.string() << ": cannot be written\n";
  return static_cast<bool>(stream);
}

int diagnose(const Options& options) {
  model::ModelSpec nominal = model::nominal_model(options.model);
  if (nominal.parts.empty()) nominal = model::read_model(options.model);
  std::vector<messages::Recording> recordings;
  for (const std::string& folder : options.recordings) {
    try {
      recordings.push_back(messages::read_recording(folder));
    } catch (const messages::RecordingError& e) {
      std::cerr << e.what() << '\n';
      return kBadInput;
    }
  }
  identify::DiagnosisOptions settings;
  if (!options.rig.empty()) settings.design.rig = read_rig_limits(options.rig);
  settings.threads = options.threads;
  std::optional<identify::Study> made;
  try {
    made = identify::diagnose(std::move(recordings), options.recordings, nominal, settings);
  } catch (const std::invalid_argument& e) {
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  const identify::Study& study = *made;
  const identify::Diagnosis& d = study.diagnosis;

  const std::filesystem::path out(options.out);
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) {
    std::cerr << options.out << ": " << error.message() << '\n';
    return kFailure;
  }
  const bool written =
      write(out / "diagnosis.json", identify::diagnosis_json(d).dump(2) + "\n") &&
      write(out / "nominal.toml", model::model_text(d.nominal, "The given model, refitted.")) &&
      write(out / "model.toml", model::model_text(d.model, "The model with what it lacked."));
  if (!written) return kFailure;
  // One of an earlier diagnosis would be taken for this one's.
  std::filesystem::remove(out / "next_experiment.toml", error);
  if (d.design.experiment && !write(out / "next_experiment.toml", d.design.experiment->protocol)) return kFailure;
  if (options.report) {
    try {
      identify::write_diagnosis_report(study, out);
    } catch (const std::exception& e) {
      // The diagnosis stands without its figures.
      std::cerr << "report.html: " << e.what() << '\n';
    }
  }

  std::printf("%s\n", std::string(identify::name_of(d.verdict)).c_str());
  for (const auto& missing : d.missing) {
    std::printf("  %-20s p = %.2f ", std::string(missing.effect->name).c_str(), missing.probability);
    for (const auto& value : missing.parameters)
      std::printf("  %s = %.4g [%.4g, %.4g]", value.name.c_str(), value.value, value.low, value.high);
    std::printf("\n");
  }
  if (!d.described_by.empty())
    std::printf("  unknown, described as a function of %s\n", d.described_by.c_str());
  if (d.design.experiment)
    std::printf("  tied: %s. To settle it: %s (next_experiment.toml, %.0f s)\n", d.design.separates().c_str(),
                d.design.experiment->text.c_str(), d.design.experiment->duration_s);
  for (const auto& pair : d.design.inseparable) std::printf("  %s\n", pair.text.c_str());
  for (const auto& fault : d.faults) std::printf("  data: %s\n", fault.text.c_str());
  std::printf("  rms %.4g N nominal, %.4g N with it; noise %.4g N; %s/\n", d.nominal_errors.train_rmse_N,
              d.model_errors.train_rmse_N, d.noise_N, options.out.c_str());
  return kOk;
}

Command add_diagnose(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand(
      "diagnose", "Where a model and recordings differ, what physics is missing, and a model that has it");
  sub->add_option("RECORDING", options->recordings, "Folders of recordings, fitted jointly")->required();
  sub->add_option("--model", options->model, "Nominal model: slse1, slse2 or a TOML file")->required();
  sub->add_option("--out", options->out, "Folder for diagnosis.json, the models and report.html")->required();
  sub->add_option("--rig", options->rig,
                  "Rig whose limits a further experiment keeps (config/rigs/); else those of the recordings");
  sub->add_option("--threads", options->threads, "Threads to use")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  sub->add_flag("!--no-report", options->report, "Leave out report.html and its figures");
  return {sub, [options] { return diagnose(*options); }};
}

const Registration kDiagnose(30, add_diagnose);

}  // namespace
}  // namespace isorig::cli
