#include "proof/scoring/runner.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/parallel.hpp"
#include "base/process.hpp"
#include "base/text_file.hpp"
#include "messages/csv.hpp"
#include "messages/recording.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {

void run_case(const CaseToRun& one, const std::filesystem::path& folder, const RunOptions& options) {
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  const std::filesystem::path log = folder / "log.txt";
  std::vector<std::string> command{options.isorig, "diagnose",  one.train,
                                   "--model",      one.nominal, "--out",
                                   folder,         "--threads", std::to_string(options.threads)};
  command.insert(command.end(), options.also.begin(), options.also.end());
  const base::ProcessResult diagnosed = base::run_process(command, log);
  nlohmann::ordered_json json{
      {"exit_code", diagnosed.exit_code}, {"wall_s", diagnosed.wall_s}, {"cpu_s", diagnosed.cpu_s}};
  if (diagnosed.exit_code == 0) {
    // The forces to be predicted are not within the tool's reach.
    messages::Recording heldout = messages::read_recording(one.heldout);
    std::ranges::fill(heldout.frame.force_N, 0.0);
    messages::write_recording(folder / "heldout-without-force", heldout);
    for (const char* model : {"nominal", "model"}) {
      const base::ProcessResult predicted =
          base::run_process({options.isorig, "predict", folder / "heldout-without-force", "--model",
                             folder / (std::string(model) + ".toml"), "--out", folder / (std::string(model) + ".csv")},
                            log);
      json["predict_" + std::string(model)] = predicted.exit_code;
    }
    std::filesystem::remove_all(folder / "heldout-without-force");
  }
  write_text(folder / "run.json", json.dump(2) + "\n");
}

void run_cases(const std::vector<CaseToRun>& cases, const std::filesystem::path& results, const RunOptions& options) {
  // Without it a case has failed: one of an earlier call is none of this one's, should this one be interrupted.
  for (const CaseToRun& one : cases) std::filesystem::remove(results / one.name / "run.json");
  base::parallel_for(cases.size(), options.jobs,
                     [&](std::size_t i) { run_case(cases[i], results / cases[i].name, options); });
}

std::vector<CaseToRun> cases_of(const std::filesystem::path& study) {
  const auto listed = nlohmann::json::parse(base::read_text_file(study / "cases.json"));
  std::vector<CaseToRun> cases;
  for (const auto& one : listed.at("cases")) {
    const std::string name = one.at("case");
    cases.push_back({name, one.at("nominal"), study / name / "train", study / name / "heldout"});
  }
  return cases;
}

std::vector<double> true_force_N(const std::filesystem::path& labels_file, const Label& label) {
  const std::filesystem::path file = labels_file.parent_path() / "truth" / (label.name + ".csv");
  if (sha256(base::read_text_file(file)) != label.truth_sha256)
    throw std::runtime_error(file.string() + " was changed after it was sealed");
  std::vector<double> t_s, force_N;
  const messages::CsvColumn columns[] = {{"t_s", &t_s}, {"force_N", &force_N}};
  messages::read_number_csv(file, columns);
  return force_N;
}

Outcome collect(const std::filesystem::path& folder, const std::vector<double>& reference_N) {
  Outcome outcome;
  try {
    const nlohmann::json run = nlohmann::json::parse(base::read_text_file(folder / "run.json"));
    // What a run that failed took counts as well: left out, the slowest would be the cheapest.
    const double wall_s = run.at("wall_s"), cpu_s = run.at("cpu_s");
    const int code = run.at("exit_code");
    if (code == 0) outcome = read_diagnosis(folder / "diagnosis.json");
    outcome.wall_s = wall_s;
    outcome.cpu_s = cpu_s;
    if (code != 0) throw std::runtime_error("diagnose ended with exit code " + std::to_string(code));
    outcome.nominal_rmse_N = prediction_rmse_N(folder / "nominal.csv", reference_N);
    outcome.model_rmse_N = prediction_rmse_N(folder / "model.csv", reference_N);
  } catch (const std::exception& error) {
    outcome.failed = true;
    outcome.why = error.what();
  }
  return outcome;
}

}  // namespace isorig::proof
