#include <algorithm>
#include <atomic>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/parallel.hpp"
#include "base/text_file.hpp"
#include "cli/screen/progress.hpp"
#include "messages/recording.hpp"
#include "proof/baselines/baseline.hpp"
#include "proof/commands.hpp"
#include "proof/scoring/sensitivity.hpp"
#include "proof/scoring/study_run.hpp"
#include "proof/scoring/table.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;

struct StudyPaths {
  fs::path study;
  fs::path results;
  fs::path labels;
  StudyCall run;
  bool baselines = true;

  [[nodiscard]] fs::path results_or_default() const { return results.empty() ? study / "results" : results; }
};

void tell(const std::vector<Score>& scores, const std::vector<std::vector<std::string>>& rows, const fs::path& out,
          const std::string& title, const std::string& seal) {
  for (const auto& row : rows)
    std::printf("%-9s %-16s %-44s %5s %6s  %s; %s %%\n", row[0].c_str(), row[1].c_str(), row[2].c_str(), row[3].c_str(),
                row[4].c_str(), row[5].c_str(), row[6].c_str());
  std::printf("\n%s", table_text(scores).c_str());
  nlohmann::ordered_json json = score_json(scores);
  if (!seal.empty()) json["labels_sha256"] = seal;
  write_text(out / "score.json", json.dump(2) + "\n");
  write_score_report(out, title, scores, rows, seal);
  std::printf("%s, %s\n", (out / "score.json").c_str(), (out / "report.html").c_str());
}

void run_study(const StudyPaths& paths) {
  const std::vector<CaseToRun> cases = cases_of(paths.study);
  // Kept with the results: these labels, and no later ones, are what they will be scored with.
  const std::string hash = published_hash(paths.study / "labels.sha256");
  const fs::path kept = paths.results_or_default() / "labels.sha256";
  if (fs::exists(kept) && published_hash(kept) != hash)
    throw std::runtime_error(paths.results_or_default().string() + " holds the results of another study than " +
                             paths.study.string() + "; move them away, or name another folder with --results");
  write_text(paths.results_or_default() / "labels.sha256", hash + "  labels.json\n");
  std::printf("labels sealed as %s\n", hash.c_str());
  std::fflush(stdout);
  run_cases(cases, paths.study / "cases.json", paths.results_or_default(), paths.run);
}

/// The tool's own score comes first. Returned under the name of the laws that were concealed, to stand beside others.
Score score_study(const StudyPaths& paths) {
  const fs::path labels_file = paths.labels.empty() ? paths.study / "sealed" / "labels.json" : paths.labels;
  const fs::path results = paths.results_or_default();
  const std::string unsealed = unseal(labels_file, results / "labels.sha256");
  const std::vector<Label> labels = parse_labels(unsealed);
  const StudyResults found(results);
  std::vector<Outcome> outcomes(labels.size());
  std::vector<std::vector<Outcome>> by_method(paths.baselines ? baselines().size() : 0,
                                              std::vector<Outcome>(labels.size()));
  {
    // A case at a time: what it was asked and answered is gone before the next, its outcome stays.
    cli::Progress progress("score");
    std::atomic<std::size_t> ended = 0;
    base::parallel_for(labels.size(), paths.run.each.jobs, [&](std::size_t i) {
      const std::vector<double> truth_N = true_force_N(labels_file, labels[i]);
      outcomes[i] = found.outcome(labels[i].name, truth_N);
      if (paths.baselines) {
        const auto each = run_baselines(messages::read_recording(paths.study / labels[i].name / "train"),
                                        messages::read_recording(paths.study / labels[i].name / "heldout"),
                                        labels[i].nominal, truth_N, labels[i].name);
        for (std::size_t m = 0; m < each.size(); ++m) by_method[m][i] = each[m];
      }
      const std::size_t now = ++ended;
      progress.at(static_cast<double>(now) / static_cast<double>(labels.size()),
                  std::to_string(now) + " of " + std::to_string(labels.size()));
    });
  }
  const auto left = std::ranges::count_if(labels, [&found](const Label& label) { return !found.tried(label.name); });
  if (left > 0)
    std::fprintf(stderr, "%td of %zu cases were not run yet, and count as failed: `isorig-proof run %s` goes on\n",
                 left, labels.size(), paths.study.c_str());
  std::vector<Score> scores{score("isorig", labels, outcomes)};
  for (std::size_t m = 0; m < by_method.size(); ++m)
    scores.push_back(score(std::string(baselines()[m]), labels, by_method[m]));
  tell(scores, case_rows(labels, outcomes, false), results, "Concealed effects: what was found",
       published_hash(results / "labels.sha256"));
  Score first = std::move(scores.front());
  first.method = laws_of_labels(unsealed) + " laws";
  return first;
}

void score_studies(const StudyPaths& paths, const std::vector<fs::path>& studies) {
  if (studies.size() > 1 && !(paths.labels.empty() && paths.results.empty()))
    throw std::runtime_error("--labels and --results belong to one study; " + std::to_string(studies.size()) +
                             " were given: score them one by one");
  std::vector<Score> scores;
  for (const fs::path& study : studies) {
    StudyPaths one = paths;
    one.study = study;
    scores.push_back(score_study(one));
  }
  if (scores.size() > 1) std::printf("\n%s", comparison_text(scores).c_str());
}

/// Of cases made elsewhere what whoever is asked about them may know, as a study's cases.json has it.
std::string list_text(const std::vector<CaseToRun>& cases) {
  nlohmann::ordered_json listed = nlohmann::ordered_json::array();
  for (const CaseToRun& one : cases) {
    // A file counts by what is in it, and is found from any folder.
    const bool is_file = one.nominal != "slse1" && one.nominal != "slse2";
    listed.push_back({{"case", one.name}, {"nominal", is_file ? fs::absolute(one.nominal).string() : one.nominal}});
    if (is_file) listed.back()["nominal_sha256"] = sha256(base::read_text_file(one.nominal));
  }
  return nlohmann::ordered_json{{"cases", std::move(listed)}}.dump(2) + "\n";
}

/// Cases made elsewhere: no noise-free truth, so the recorded force and the labels' noise stand in for it.
void score_practice(const StudyPaths& paths) {
  const std::vector<Label> labels = parse_foreign_labels(base::read_text_file(paths.labels));
  std::vector<CaseToRun> cases;
  for (const Label& label : labels)
    cases.push_back(
        {label.name, label.nominal, paths.study / label.name / "train", paths.study / label.name / "heldout"});
  if (paths.results.empty()) throw std::runtime_error("practice cases are not written into: --out is needed");
  const fs::path list = paths.results / "cases.json";
  write_text(list, list_text(cases));
  run_cases(cases, list, paths.results, paths.run);
  const StudyResults found(paths.results);
  std::vector<Outcome> outcomes;
  for (const CaseToRun& one : cases)
    outcomes.push_back(found.outcome(one.name, messages::read_recording(one.heldout).frame.force_N));
  tell({score("isorig", labels, outcomes, true)}, case_rows(labels, outcomes, true), paths.results,
       "Practice cases: what was found", "");
}

void add_each_options(CLI::App* sub, RunOptions& run) {
  sub->add_option("--isorig", run.isorig, "The program to judge")->capture_default_str();
  sub->add_option("-j,--jobs", run.jobs, "Cases at a time")->capture_default_str()->check(CLI::Range(1, 64));
  sub->add_option("--threads", run.threads, "Threads of each diagnosis")->capture_default_str();
}

void add_run_options(CLI::App* sub, StudyCall& run) {
  add_each_options(sub, run.each);
  sub->add_option_function<std::vector<std::string>>(
      "--decide",
      [&run](const std::vector<std::string>& numbers) {
        for (const std::string& number : numbers) run.each.also.insert(run.each.also.end(), {"--decide", number});
      },
      "NAME=VALUE of a number that decides each diagnosis (isorig diagnose --deciding)");
  sub->add_option("--retries", run.retries, "How often a case that failed is repeated")
      ->capture_default_str()
      ->check(CLI::Range(0, 100));
  sub->add_option("--on", run.on, "Where the cases are run")
      ->capture_default_str()
      ->check(CLI::IsMember({"local", "slurm"}));
  sub->add_option("--slurm-options", run.slurm.more, "Further options of sbatch, in quotes");
  sub->add_option("--per-task", run.slurm.per_task, "Cases of one Slurm task, at least")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
}

}  // namespace

void add_run(CLI::App& app) {
  auto paths = std::make_shared<StudyPaths>();
  auto* sub = app.add_subcommand("run",
                                 "Run `isorig diagnose` and `isorig predict` on every case of a study; what is done is "
                                 "not run again");
  sub->add_option("STUDY", paths->study, "Folder that generate wrote")->required();
  sub->add_option("--results", paths->results, "Folder for what the tool says (default: STUDY/results)");
  add_run_options(sub, paths->run);
  sub->callback([paths] { run_study(*paths); });
}

void add_score(CLI::App& app) {
  auto paths = std::make_shared<StudyPaths>();
  auto studies = std::make_shared<std::vector<fs::path>>();
  auto* sub = app.add_subcommand("score", "Verify the seal and tabulate the results, beside the baselines");
  sub->add_option("STUDY", *studies, "Folder that generate wrote; several are also set side by side")->required();
  sub->add_option("--labels", paths->labels, "The sealed labels (default: STUDY/sealed/labels.json)");
  sub->add_option("--results", paths->results, "Folder that run wrote (default: STUDY/results)");
  sub->add_flag("--baselines,!--no-baselines", paths->baselines, "Run the methods to compare with");
  sub->add_option("-j,--jobs", paths->run.each.jobs, "Cases at a time")->capture_default_str();
  sub->callback([paths, studies] { score_studies(*paths, *studies); });
}

void add_score_practice(CLI::App& app) {
  auto paths = std::make_shared<StudyPaths>();
  auto* sub = app.add_subcommand("score-practice", "Run and score cases that were made elsewhere");
  sub->add_option("--cases", paths->study, "Folder with case-*/train and case-*/heldout")->required();
  sub->add_option("--labels", paths->labels, "Their labels")->required();
  sub->add_option("--out", paths->results, "Folder for results, score.json and report.html")->required();
  add_run_options(sub, paths->run);
  sub->callback([paths] { score_practice(*paths); });
}

void add_case(CLI::App& app) {
  struct Options {
    fs::path folder, list;
    RunOptions run;
  };
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("case", "One case, in the working folder (isorig-proof run)");
  sub->group("");
  sub->add_option("CASE", options->folder, "Its folder")->required();
  sub->add_option("OPTION", options->run.also, "Further words of its diagnosis, behind --");
  sub->add_option("--cases", options->list, "The list with its nominal model")->required();
  sub->add_option("--isorig", options->run.isorig, "The program to judge")->required();
  sub->add_option("--threads", options->run.threads, "Threads of the diagnosis")->required();
  sub->callback([options] {
    if (const std::string failed = run_case(case_in(options->folder, options->list), ".", options->run);
        !failed.empty())
      throw std::runtime_error(failed);
  });
}

void add_task(CLI::App& app) {
  struct Options {
    fs::path results, list;
    cli::pieces::Share share;
  };
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("campaign-pieces", "One task of a study's job array (isorig-proof run --on slurm)");
  sub->group("");
  sub->add_option("DIR", options->results, "Folder of the results")->required();
  sub->add_option("--list", options->list, "Cases of the array")->required();
  sub->add_option("--task", options->share.task, "Which task this is")->required();
  sub->add_option("--of", options->share.of, "How many there are")->required()->check(CLI::PositiveNumber);
  sub->callback([options] { run_task(options->results, options->list, options->share); });
}

void add_sensitivity(CLI::App& app) {
  auto options = std::make_shared<SensitivityOptions>();
  options->run.threads = 1;
  auto* sub = app.add_subcommand(
      "sensitivity", "What changes when each deciding number is halved and doubled; what is finished is not run again");
  sub->add_option("STUDY", options->study, "Folder that generate wrote")->required();
  sub->add_option("--only", options->only, "These numbers (`isorig diagnose --deciding` lists all)");
  sub->add_option("--labels", options->labels, "The sealed labels (default: STUDY/sealed/labels.json)");
  add_each_options(sub, options->run);
  sub->callback([options] {
    const Sensitivity found = measure_sensitivity(*options);
    std::printf("%s", sensitivity_text(found).c_str());
    write_text(options->study / "sensitivity.json", sensitivity_json(found).dump(2) + "\n");
    write_text(options->study / "sensitivity.md", sensitivity_text(found));
    std::printf("\n%s, %s\n", (options->study / "sensitivity.json").c_str(),
                (options->study / "sensitivity.md").c_str());
  });
}

}  // namespace isorig::proof
