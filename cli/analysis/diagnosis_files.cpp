#include "cli/analysis/diagnosis_files.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/toml_reader.hpp"
#include "base/whole_file.hpp"
#include "cli/screen/duration.hpp"
#include "identify/diagnose/reliability/reliability.hpp"
#include "identify/diagnosis_report/diagnosis_report.hpp"
#include "identify/pooling/read_diagnosis.hpp"
#include "identify/report/page.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::cli {

model::ModelSpec read_nominal(const std::string& model) {
  model::ModelSpec nominal = model::nominal_model(model);
  if (!nominal.parts.empty()) return nominal;
  if (!std::filesystem::exists(model))
    throw base::ConfigError(
        {{model, 0, 0, "no such file, and no model of that name; slse1 and slse2 are known by name"}});
  return model::read_model(model);
}

std::string words_and_name(const std::string& key) {
  const std::string words = model::explanation_words(key);
  return words == key || key == "nominal" ? words : words + " [" + key + "]";
}

std::string number_line(double value, double low, double high, const model::NumberSheet* sheet,
                        const std::string& name) {
  const std::string words = model::meaning_of(sheet);
  const std::string out = identify::report::interval_text(value, low, high) + model::unit_behind(sheet);
  if (words.empty()) return name + ": " + out;
  return out + ": " + words + " [" + name + "]";
}

bool write_diagnosis(const identify::Study& study, const std::filesystem::path& folder,
                     const identify::report::Made* made) {
  const identify::Diagnosis& d = study.diagnosis;
  std::filesystem::create_directories(folder);
  nlohmann::ordered_json json = identify::diagnosis_json(d);
  std::vector<messages::RecordingMetadata> recordings;
  std::vector<double> ids;
  for (const identify::Series& one : study.series) {
    recordings.push_back(one.recording.metadata);
    ids.push_back(one.excitation.reference.recording_id);
  }
  json["recordings"] = identify::pooling::recordings_json(recordings, ids);
  base::write_whole_file(folder / "diagnosis.json", json.dump(2) + "\n");
  base::write_whole_file(folder / "nominal.toml", model::model_text(d.nominal, "The given model, refitted."));
  const std::string comment = d.not_modelled.why.empty() ? "The model with what it lacked."
                                                         : "The model with what it lacked, as far as it predicts no "
                                                           "worse for it.\n" +
                                                               d.not_modelled.text();
  base::write_whole_file(folder / "model.toml", model::model_text(d.model, comment));
  // Those of an earlier diagnosis would be taken for this one's.
  std::filesystem::remove(folder / "next_experiment.toml");
  std::filesystem::remove(folder / "diagnosis-report.html");
  if (d.design.experiment) base::write_whole_file(folder / "next_experiment.toml", d.design.experiment->protocol);
  if (made == nullptr) return true;
  try {
    identify::write_diagnosis_report(study, folder, *made);
    return true;
  } catch (const std::exception& e) {
    std::cerr << "diagnosis-report.html: not written; the other files are: " << e.what() << '\n';
    return false;
  }
}

namespace {

using identify::report::number_text;

/// From which size these recordings could have shown the effect, and told it from its nearest rival.
void print_discernible(const identify::Diagnosis& d, const identify::MissingEffect& missing) {
  const auto able = std::ranges::find(d.discernible, missing.effect, &identify::Discernible::effect);
  if (able == d.discernible.end() || !std::isfinite(able->seen_from_N)) return;
  std::printf("      adds up to %s N to the force; these recordings show it from %s N on",
              number_text(missing.size_N, 3).c_str(), number_text(able->seen_from_N, 3).c_str());
  if (able->nearest != nullptr) {
    const std::string nearest = model::effect_words(able->nearest->name);
    // A fit that hardly tells the two apart is nearer to the truth than the linear sum of discernible.hpp.
    if (missing.substitute == able->nearest)
      std::printf(", and hardly tell it from %s", nearest.c_str());
    else if (std::isfinite(able->told_from_N))
      std::printf(", and tell it from %s from %s N on", nearest.c_str(), number_text(able->told_from_N, 3).c_str());
    else
      std::printf(", and cannot tell it from %s", nearest.c_str());
  }
  std::printf("\n");
}

/// What is missing in words, with its numbers in their units; the names of files in brackets.
void print_missing(const identify::Diagnosis& d, const identify::MissingEffect& missing) {
  std::printf("  %s, probability %.2f%s\n", words_and_name(std::string(missing.effect->name)).c_str(),
              missing.probability, missing.parameters.empty() ? "" : "; its numbers [95 % interval]:");
  for (const auto& value : missing.parameters) {
    const auto* sheet = model::sheet_of(*value.law, value.name);
    std::printf("      %s\n", number_line(value.value, value.low, value.high, sheet, value.key()).c_str());
  }
  print_discernible(d, missing);
}

/// Explanations that are left, and the experiment that tells them apart.
void print_tied(const identify::Design& design) {
  if (!design.tied.empty()) std::printf("  which of these it is, the recordings leave open:\n");
  for (const auto& rival : design.tied)
    std::printf("      probability %.2f  %s\n", rival.probability, words_and_name(rival.key).c_str());
  if (design.experiment)
    std::printf("  to tell them apart, run next_experiment.toml (%s): %s\n",
                duration_text(design.experiment->duration_s).c_str(), design.experiment->text.c_str());
  for (const auto& pair : design.inseparable) std::printf("  %s\n", pair.text.c_str());
}

/// What changes the meaning of a number and is not printed elsewhere: a fit that stopped short, an event that belongs
/// to its recording, the reading of the spring.
void print_notes(const identify::Diagnosis& d) {
  const std::string not_modelled = d.not_modelled.why.empty() ? std::string() : d.not_modelled.text();
  for (const std::string& note : d.notes) {
    if (note == not_modelled ||
        std::ranges::find(d.design.inseparable, note, &identify::Inseparable::text) != d.design.inseparable.end())
      continue;
    std::printf("  note: %s\n", note.c_str());
  }
}

/// The first of each kind; a recording with hundreds of gaps would hide everything else.
void print_faults(const std::vector<identify::DataFault>& faults) {
  constexpr std::size_t kShown = 5;
  std::map<std::string, std::size_t> of_kind;
  for (const auto& fault : faults)
    if (++of_kind[fault.kind] <= kShown) std::printf("  data: %s\n", fault.text.c_str());
  for (const auto& [kind, count] : of_kind)
    if (count > kShown)
      std::printf("  data: %zu more of kind %s, listed in diagnosis.json\n", count - kShown, kind.c_str());
}

}  // namespace

void print_diagnosis(const identify::Diagnosis& d, const std::filesystem::path& folder) {
  for (const auto& warning : d.warnings) std::printf("warning: %s\n", warning.c_str());
  std::printf("%s\n", std::string(identify::words_of(d.verdict)).c_str());
  if (d.unjudged) std::printf("  %s\n  to judge it, record: %s\n", d.unjudged->why.c_str(), d.unjudged->record.c_str());
  for (const auto& missing : d.missing) print_missing(d, missing);
  if (!d.described_by.empty())
    std::printf("  something that the catalogue does not know; %s\n",
                identify::described_in_words(d.discovered, d.described_by).c_str());
  for (const auto& law : d.discovered)
    std::printf("    %s (inclusion probability %s)\n", law.formula.c_str(),
                number_text(law.inclusion_probability, 3).c_str());
  if (d.reliability)
    for (const std::string& text : identify::reliability_text(*d.reliability))
      std::printf("  simulated from these explanations: %s\n", text.c_str());
  print_tied(d.design);
  print_faults(d.faults);
  print_notes(d);
  if (!d.not_modelled.why.empty()) std::printf("  %s\n", d.not_modelled.text().c_str());
  const auto N = [](double value) { return number_text(value, 4); };
  if (d.heldout.all)
    std::printf(
        "  parts left out of the fit and then predicted: the given model is off by %s N rms, model.toml by %s N\n",
        N(d.heldout.all->nominal_rmse_N).c_str(), N(d.heldout.all->model_rmse_N).c_str());
  else
    std::printf("  too little to leave anything out: how well the models predict is not known\n");
  const bool at_most = d.noise_source != identify::NoiseSource::kRests && d.noise_N > d.model_errors.train_rmse_N;
  std::printf(
      "  all that was fitted: the given model is off by %s N rms, model.toml by %s N; noise of the force %s%s N\n",
      N(d.nominal_errors.train_rmse_N).c_str(), N(d.model_errors.train_rmse_N).c_str(), at_most ? "at most " : "",
      N(d.noise_N).c_str());
  std::printf("written to %s\n", folder.c_str());
}

}  // namespace isorig::cli
