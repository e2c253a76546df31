#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "base/fingerprint.hpp"
#include "base/lock_file.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "cli/analysis/answers.hpp"
#include "cli/analysis/diagnosis_files.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/provenance.hpp"
#include "cli/screen/progress.hpp"
#include "identify/diagnose/claims_json.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/deciding/deciding_table.hpp"
#include "identify/diagnose/reliability/reliability.hpp"
#include "messages/recording.hpp"
#include "messages/recording_id.hpp"

namespace isorig::cli {
namespace {

struct DiagnoseOptions {
  std::vector<std::string> recordings;
  std::string model;
  std::string out, rig;
  std::vector<std::string> decide;
  std::size_t check_names = 0;
  unsigned threads = 2;
  bool report = true;
  bool json = false;
};

/// Before minutes of work, not after: "" when `out` is a folder that can be written, or can be made.
std::string unwritable(const std::filesystem::path& out) {
  std::error_code error;
  std::filesystem::path there = std::filesystem::absolute(out);
  while (!std::filesystem::exists(there, error) && there.has_relative_path()) there = there.parent_path();
  if (!std::filesystem::is_directory(there, error))
    return there.string() + " is a file; name a folder for the diagnosis with --out";
  if (::access(there.c_str(), W_OK | X_OK) != 0)
    return there.string() + " may not be written; name another folder with --out";
  if (std::filesystem::exists(out / "investigation.json", error))
    return "holds an investigation, whose model.toml this would replace; name another folder with --out";
  return {};
}

/// False, and why on stderr, where a number cannot be decided so.
bool decide_otherwise(const std::vector<std::string>& assignments) {
  for (const std::string& assignment : assignments) {
    try {
      identify::decide(assignment);
    } catch (const std::invalid_argument& e) {
      std::cerr << "isorig diagnose --decide: " << base::printable(e.what()) << '\n';
      return false;
    }
  }
  return true;
}

/// In place of a diagnosis, which needs more than this asks for.
void print_deciding(bool as_json) {
  if (as_json)
    std::cout << identify::deciding_json().dump(2) << '\n';
  else
    std::cout << identify::deciding_table();
  throw CLI::Success();
}

/// What simulated recordings belong to: the same text, the same simulations.
std::string what_is_checked(const std::vector<messages::Recording>& recordings, const model::ModelSpec& nominal) {
  std::string of = version_and_revision() + "; model " + base::fingerprint(model::model_text(nominal, "")) + ";";
  for (const messages::Recording& recording : recordings) of += " " + std::to_string(messages::fingerprint(recording));
  for (const identify::Decided& one : identify::decided())
    of += "; " + std::string(one.name) + " = " + base::number_text(one.value);
  return of;
}

/// States the probabilities by simulations of these recordings. `file` keeps them as they come: those that it holds of
/// these recordings are not made again, and a call that is ended loses the last few.
void check_names(identify::Study& study, const std::vector<messages::Recording>& recordings,
                 const model::ModelSpec& nominal, const DiagnoseOptions& options, const std::filesystem::path& file) {
  const std::string of = what_is_checked(recordings, nominal);
  identify::ReliabilityOptions settings;
  settings.threads = options.threads;
  if (std::filesystem::exists(file))
    settings.known =
        identify::rehearsals_of(base::read_text_file(file), of).value_or(std::vector<identify::Rehearsal>());
  const std::size_t wanted = options.check_names, between_writes = std::size_t{4} * options.threads;
  Progress progress("check names");
  identify::Reliability reliability;
  do {
    settings.rehearsals = std::min(wanted, settings.known.size() + between_writes);
    settings.on_progress = [&](double fraction) {
      progress.at(fraction * static_cast<double>(settings.rehearsals) / static_cast<double>(wanted),
                  "diagnosing simulated recordings");
    };
    reliability = identify::measure_reliability(study, recordings, options.recordings, nominal, settings);
    // More of them from an earlier call stay in the file.
    if (settings.known.size() >= settings.rehearsals) break;
    settings.known = reliability.rehearsals;
    base::write_whole_file(file, identify::name_check_json(settings.known, of).dump(1) + "\n");
  } while (settings.known.size() < wanted);
  identify::restate(study.diagnosis, std::move(reliability));
}

int diagnose(const DiagnoseOptions& options) {
  if (!decide_otherwise(options.decide)) return kUsage;
  if (const std::string why = unwritable(options.out); !why.empty()) {
    std::cerr << options.out << ": " << why << '\n';
    return kFailure;
  }
  const std::filesystem::path out = options.out;
  for (const char* name : {"model.toml", "nominal.toml"}) {
    std::error_code error;
    if (!std::filesystem::equivalent(options.model, out / name, error)) continue;
    std::cerr << options.model << ": is the model that is asked about, and the diagnosis would take its place; name "
              << "another folder with --out\n";
    return kFailure;
  }
  const base::FolderLock alone(out);
  std::vector<messages::Recording> recordings;
  for (const std::string& folder : options.recordings) {
    try {
      recordings.push_back(messages::read_recording_of_any_output(folder));
    } catch (const messages::RecordingError& e) {
      std::cerr << e.what() << '\n';
      return kBadInput;
    }
  }
  if (std::ranges::any_of(recordings, [](const auto& r) { return r.metadata.output != messages::Output::kForce; })) {
    if (options.check_names > 0) {
      std::cerr << "isorig diagnose --check-names: only of recordings that ask for the force; leave it out\n";
      return kUsage;
    }
    return diagnose_answer(recordings, options.recordings, options.model, options.out, options.report);
  }
  const model::ModelSpec nominal = read_nominal(options.model);
  identify::DiagnosisOptions settings;
  if (!options.rig.empty()) settings.design.rig = read_rig_limits(options.rig);
  settings.threads = options.threads;
  std::optional<Progress> progress(std::in_place, "diagnose");
  settings.on_progress = [&](double fraction, const char* doing) { progress->at(fraction, doing); };
  std::optional<identify::Study> made;
  const std::vector<messages::Recording> as_read = options.check_names > 0 ? recordings : decltype(recordings)();
  try {
    made = identify::diagnose(std::move(recordings), options.recordings, nominal, settings);
  } catch (const std::invalid_argument& e) {
    progress.reset();
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  progress.reset();
  std::vector<std::pair<std::string, std::string>> inputs{{"Nominal model", options.model}};
  for (const std::string& folder : options.recordings) inputs.emplace_back("Recording", folder);
  const auto provenance = made_by_this_call(std::move(inputs));
  const auto write = [&] { return write_diagnosis(*made, options.out, options.report ? &provenance : nullptr); };
  bool whole = write();
  // The diagnosis stands before minutes of simulations, and whatever becomes of them.
  const std::filesystem::path checked = std::filesystem::path(options.out) / "name-check.json";
  if (options.check_names > 0) {
    check_names(*made, as_read, nominal, options, checked);
    whole = write();
  } else {
    std::filesystem::remove(checked);  // of an earlier diagnosis
  }
  print_diagnosis(made->diagnosis, options.out);
  return whole ? kOk : kFailure;
}

Command add_diagnose(CLI::App& app) {
  auto options = std::make_shared<DiagnoseOptions>();
  auto* sub = app.add_subcommand(
      "diagnose", "Where a model and recordings differ, what physics is missing, and a model that has it");
  sub->add_option("RECORDING", options->recordings, "Folders of recordings, fitted jointly")->required();
  sub->add_option("--model", options->model, "Nominal model: slse1, slse2 or a TOML file")->required();
  sub->add_option("--out", options->out, "Folder for diagnosis.json, the models and diagnosis-report.html")->required();
  sub->add_option("--rig", options->rig,
                  "Rig whose limits a further experiment keeps (config/rigs/); else those of the recordings");
  sub->add_option("--threads", options->threads, "Threads to use")->capture_default_str()->check(CLI::Range(1, 64));
  sub->add_flag("!--no-report", options->report, "Leave out diagnosis-report.html");
  sub->add_option("--decide", options->decide,
                  "NAME=VALUE: decide by another value than the stated one, and say so in the result")
      ->allow_extra_args(false);
  sub->add_option("--check-names", options->check_names,
                  "Simulate so many recordings from the explanations that were weighed, diagnose them, and state "
                  "probabilities by how many of their names are right; each takes some seconds, like the diagnosis")
      ->check(CLI::Range(0, 100'000));
  auto* json = sub->add_flag("--json", options->json, "With --deciding: as JSON");
  json->needs(sub->add_flag_callback(
      "--deciding", [options] { print_deciding(options->json); },
      "The numbers that decide, each with what it decides and where it comes from"));
  sub->add_flag_callback("--undated", leave_the_time_out,
                         "No time on the page: the same recordings give the same bytes");
  return {sub, [options] { return diagnose(*options); }};
}

const Registration kDiagnose(30, add_diagnose);

}  // namespace
}  // namespace isorig::cli
