#include "proof/scoring/runner.hpp"

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/process.hpp"
#include "base/text_file.hpp"
#include "messages/csv.hpp"
#include "messages/recording.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {

namespace fs = std::filesystem;

fs::path path_of(const fs::path& program) {
  if (program.has_parent_path()) return fs::absolute(program);
  const char* variable = std::getenv("PATH");
  std::string folders = variable == nullptr ? "" : variable;
  for (std::size_t from = 0; from < folders.size();) {
    const std::size_t to = std::min(folders.find(':', from), folders.size());
    if (const fs::path file = fs::path(folders.substr(from, to - from)) / program; fs::exists(file))
      return fs::absolute(file);
    from = to + 1;
  }
  throw std::runtime_error(program.string() + " is not found; name it with --isorig");
}

std::string run_case(const CaseToRun& one, const fs::path& folder, const RunOptions& options) {
  fs::create_directories(folder);
  const fs::path log = folder / "log.txt";
  std::vector<std::string> command{options.isorig, "diagnose",  one.train,
                                   "--model",      one.nominal, "--out",
                                   folder,         "--threads", std::to_string(options.threads)};
  command.insert(command.end(), options.also.begin(), options.also.end());
  base::Processes children;
  const auto run = [&](const std::vector<std::string>& words) {
    return base::run_process(words, log, {.working_directory = {}, .among = &children});
  };
  std::string failed;
  const auto fails = [&](const std::string& what, int code) {
    if (code != 0 && failed.empty()) failed = what + " ended with exit code " + std::to_string(code);
  };
  const base::ProcessResult diagnosed = run(command);
  fails("diagnose", diagnosed.exit_code);
  nlohmann::ordered_json json{
      {"exit_code", diagnosed.exit_code}, {"wall_s", diagnosed.wall_s}, {"cpu_s", diagnosed.cpu_s}};
  if (diagnosed.exit_code == 0) {
    // The forces to be predicted are not within the tool's reach.
    messages::Recording heldout = messages::read_recording(one.heldout);
    std::ranges::fill(heldout.frame.force_N, 0.0);
    messages::write_recording(folder / "heldout-without-force", heldout);
    for (const char* model : {"nominal", "model"}) {
      const base::ProcessResult predicted =
          run({options.isorig, "predict", folder / "heldout-without-force", "--model",
               folder / (std::string(model) + ".toml"), "--out", folder / (std::string(model) + ".csv")});
      json["predict_" + std::string(model)] = predicted.exit_code;
      fails("predict with " + std::string(model) + ".toml", predicted.exit_code);
    }
    fs::remove_all(folder / "heldout-without-force");
  }
  write_text(folder / "run.json", json.dump(2) + "\n");
  return failed;
}

std::vector<CaseToRun> cases_of(const fs::path& study) {
  const auto listed = nlohmann::json::parse(base::read_text_file(study / "cases.json"));
  std::vector<CaseToRun> cases;
  for (const auto& one : listed.at("cases")) {
    const std::string name = one.at("case");
    cases.push_back({name, one.at("nominal"), study / name / "train", study / name / "heldout"});
  }
  return cases;
}

CaseToRun case_in(const fs::path& folder, const fs::path& list) {
  const std::string name = folder.filename();
  const auto listed = nlohmann::json::parse(base::read_text_file(list));
  for (const auto& one : listed.at("cases"))
    if (one.at("case") == name) return {name, one.at("nominal"), folder / "train", folder / "heldout"};
  throw std::runtime_error(list.string() + ": has no " + name);
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
