#include "cli/analysis/answers.hpp"

#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/number_text.hpp"
#include "base/whole_file.hpp"
#include "cli/analysis/diagnosis_files.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"
#include "cli/screen/progress.hpp"
#include "identify/diagnose/verdict.hpp"
#include "identify/response/response_report.hpp"
#include "messages/csv.hpp"

namespace isorig::cli {
namespace {

namespace response = identify::response;

void print_answer(const response::ResponseDiagnosis& d, const std::filesystem::path& out) {
  const std::string unit(response::unit_of(d.output));
  for (const std::string& warning : d.warnings) std::printf("warning: %s\n", warning.c_str());
  std::printf("%s\n", std::string(identify::verdict_words(d.verdict)).c_str());
  if (!d.why.empty()) std::printf("  %s\n  to judge it, record: %s\n", d.why.c_str(), d.record.c_str());
  for (const auto& missing : d.missing)
    std::printf("  %s, probability %.2f\n      %s\n", words_and_name(missing.effect).c_str(), missing.probability,
                missing.formula.c_str());
  for (const std::string& note : d.notes) std::printf("  %s\n", note.c_str());
  if (!d.not_modelled.empty()) std::printf("  model.toml is the nominal model: %s\n", d.not_modelled.c_str());
  const auto text = [&](double value) { return base::number_text(value, 4) + " " + unit; };
  std::printf("  parts left out of the fit and then predicted: the given model is off by %s rms, model.toml by %s\n",
              text(*d.nominal_heldout).c_str(), text(*d.model_heldout).c_str());
  std::printf("  all that was fitted: the given model is off by %s rms, model.toml by %s; noise of a reading %s\n",
              text(d.nominal.rms).c_str(), text(d.model.rms).c_str(), text(d.noise).c_str());
  std::printf("written to %s\n", out.c_str());
}

}  // namespace

int diagnose_answer(const std::vector<messages::Recording>& recordings, const std::vector<std::string>& names,
                    const std::string& nominal, const std::filesystem::path& out, bool report) {
  response::ResponseDiagnosis d;
  try {
    Progress progress("diagnose");
    d = response::diagnose_response(recordings, names, nominal,
                                    [&](double fraction, const char* doing) { progress.at(fraction, doing); });
  } catch (const std::invalid_argument& e) {
    std::cerr << e.what() << '\n';
    return kBadInput;
  }
  std::filesystem::create_directories(out);
  base::write_whole_file(out / "diagnosis.json", response::response_json(d).dump(2) + "\n");
  base::write_whole_file(out / "nominal.toml",
                         response::response_model_text(d.nominal.model, "The nominal model, fitted."));
  base::write_whole_file(out / "model.toml",
                         response::response_model_text(
                             d.model.model, d.not_modelled.empty() ? "The model with what it lacked."
                                                                   : "The nominal model: " + d.not_modelled + "."));
  // Of an earlier diagnosis.
  std::filesystem::remove(out / "next_experiment.toml");
  std::filesystem::remove(out / "diagnosis-report.html");
  if (report) {
    std::vector<std::pair<std::string, std::string>> inputs{{"Nominal model", nominal}};
    for (const std::string& name : names) inputs.emplace_back("Recording", name);
    try {
      response::write_response_report(d, out, made_by_this_call(std::move(inputs)));
    } catch (const std::exception& e) {  // the diagnosis stands without it
      std::cerr << "diagnosis-report.html: " << e.what() << '\n';
    }
  }
  print_answer(d, out);
  return kOk;
}

std::string predicted_answer(const messages::Recording& recording, const std::string& name,
                             const std::filesystem::path& file) {
  if (!response::is_response_model(file))
    throw std::invalid_argument(file.string() + ": describes no " +
                                std::string(messages::name_of(recording.metadata.output)) +
                                ", which is the output of " + name +
                                "; give model.toml of a diagnosis of such recordings (\"isorig-response/1\")");
  const response::ResponseModel model = response::read_response_model(file);
  if (model.output != recording.metadata.output)
    throw std::invalid_argument(file.string() + ": describes the " + std::string(messages::name_of(model.output)) +
                                ", and the output of " + name + " is the " +
                                std::string(messages::name_of(recording.metadata.output)));
  const response::Data data = response::data_for(recording, name, model);
  const std::vector<double> value = response::simulate(model, data, response::begin_of(data));
  std::vector<double> low, high;
  constexpr double kTwoSided95 = 1.96;
  for (const double v : value) {
    low.push_back(v - kTwoSided95 * model.error);
    high.push_back(v + kTwoSided95 * model.error);
  }
  const std::string unit(response::unit_of(model.output));
  const std::string column = std::string(messages::name_of(model.output)) + "_" + unit;
  const std::string low95 = "low95_" + unit, high95 = "high95_" + unit;
  std::vector<messages::CsvColumnView> columns{{"t_s", data.t_s}, {column, value}};
  if (model.error > 0.0) columns.insert(columns.end(), {{low95, low}, {high95, high}});
  return messages::number_csv_text(columns);
}

}  // namespace isorig::cli
