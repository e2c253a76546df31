#include "cli/diagnosis_files.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/toml_reader.hpp"
#include "identify/diagnosis_report/diagnosis_report.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli {

model::ModelSpec read_nominal(const std::string& model) {
  model::ModelSpec nominal = model::nominal_model(model);
  if (!nominal.parts.empty()) return nominal;
  if (!std::filesystem::exists(model))
    throw base::ConfigError(
        {{model, 0, 0, "no such file, and no model of that name; slse1 and slse2 are known by name"}});
  return model::read_model(model);
}

void write_diagnosis(const identify::Study& study, const std::filesystem::path& folder,
                     const identify::report::Made* made) {
  using identify::report::write_text_file;
  const identify::Diagnosis& d = study.diagnosis;
  std::filesystem::create_directories(folder);
  write_text_file(folder / "diagnosis.json", identify::diagnosis_json(d).dump(2) + "\n");
  write_text_file(folder / "nominal.toml", model::model_text(d.nominal, "The given model, refitted."));
  const std::string comment = d.not_modelled.why.empty() ? "The model with what it lacked."
                                                         : "The model with what it lacked, as far as it predicts no "
                                                           "worse for it.\n" +
                                                               d.not_modelled.text();
  write_text_file(folder / "model.toml", model::model_text(d.model, comment));
  // Those of an earlier diagnosis would be taken for this one's.
  std::filesystem::remove(folder / "next_experiment.toml");
  std::filesystem::remove(folder / "diagnosis-report.html");
  if (d.design.experiment) write_text_file(folder / "next_experiment.toml", d.design.experiment->protocol);
  if (made == nullptr) return;
  try {
    identify::write_diagnosis_report(study, folder, *made);
  } catch (const std::exception& e) {
    std::cerr << "diagnosis-report.html: not written; the other files are: " << e.what() << '\n';
  }
}

namespace {

/// From which size these recordings could have shown the effect, and told it from its nearest rival.
void print_discernible(const identify::Diagnosis& d, const identify::MissingEffect& missing) {
  const auto able = std::ranges::find(d.discernible, missing.effect, &identify::Discernible::effect);
  if (able == d.discernible.end() || !std::isfinite(able->seen_from_N)) return;
  std::printf("  %-20s size %.3g N; these recordings show it from %.3g N", "", missing.size_N, able->seen_from_N);
  if (able->nearest != nullptr && std::isfinite(able->told_from_N))
    std::printf(", and tell it from %s from %.3g N on", std::string(able->nearest->name).c_str(), able->told_from_N);
  else if (able->nearest != nullptr)
    std::printf(", and cannot tell it from %s", std::string(able->nearest->name).c_str());
  std::printf("\n");
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
  std::printf("%s\n", std::string(identify::name_of(d.verdict)).c_str());
  if (d.unjudged) std::printf("  %s\n  to judge it, record: %s\n", d.unjudged->why.c_str(), d.unjudged->record.c_str());
  for (const auto& missing : d.missing) {
    std::printf("  %-20s p = %.2f ", std::string(missing.effect->name).c_str(), missing.probability);
    for (const auto& value : missing.parameters)
      std::printf("  %s = %.4g [%.4g, %.4g]", value.key().c_str(), value.value, value.low, value.high);
    std::printf("\n");
    print_discernible(d, missing);
  }
  if (!d.described_by.empty()) std::printf("  unknown, described as a function of %s\n", d.described_by.c_str());
  if (d.design.experiment)
    std::printf("  tied: %s. To settle it: %s (next_experiment.toml, %.0f s)\n", d.design.separates().c_str(),
                d.design.experiment->text.c_str(), d.design.experiment->duration_s);
  for (const auto& pair : d.design.inseparable) std::printf("  %s\n", pair.text.c_str());
  print_faults(d.faults);
  print_notes(d);
  if (!d.not_modelled.why.empty()) std::printf("  %s\n", d.not_modelled.text().c_str());
  if (d.heldout.all)
    std::printf("  left out of the fit and predicted: rms %.4g N nominal, %.4g N with it\n",
                d.heldout.all->nominal_rmse_N, d.heldout.all->model_rmse_N);
  else
    std::printf("  too little to leave anything out: how well the models predict is not known\n");
  std::printf(
      "  rms %.4g N nominal, %.4g N with it; noise %s%.4g N; %s/\n", d.nominal_errors.train_rmse_N,
      d.model_errors.train_rmse_N,
      d.noise_source != identify::NoiseSource::kRests && d.noise_N > d.model_errors.train_rmse_N ? "at most " : "",
      d.noise_N, folder.c_str());
}

}  // namespace isorig::cli
