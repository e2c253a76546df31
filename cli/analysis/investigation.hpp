#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/report/page.hpp"

/// What an investigation has done so far, as it is kept on disk (docs/investigate.md).
namespace isorig::cli {

struct Round {
  int number = 1;
  std::string protocol;  ///< file, relative to the investigation's folder
  std::string text;      ///< what was done, in words
  std::string run;
  double rig_s = 0.0;
  std::vector<std::string> recordings;  ///< folders, relative
  bool diagnosed = false;
  std::string verdict;
  struct Explanation {
    std::string key;
    double probability = 0.0;
  };
  std::vector<Explanation> explanations;  ///< most probable first
  std::vector<std::string> found;         ///< effects with their numbers, in words
  bool tied = false;
  nlohmann::ordered_json experiment;  ///< as in diagnosis.json, null when there is none
  std::string experiment_protocol;
  std::vector<std::string> inseparable;

  [[nodiscard]] const Explanation& best() const { return explanations.front(); }
};

enum class Outcome { kRunning, kConsistent, kSettled, kUnknown, kInseparable, kRounds, kBudget, kUnjudged };
[[nodiscard]] std::string_view name_of(Outcome outcome);

struct Investigation {
  std::filesystem::path folder;
  nlohmann::ordered_json inputs;  ///< what it was asked; another question needs another folder
  std::vector<Round> rounds;
  Outcome outcome = Outcome::kRunning;
  std::string text;  ///< the answer in a sentence or two

  [[nodiscard]] double rig_s() const;
  [[nodiscard]] std::filesystem::path round_folder(int number) const {
    return folder / ("round-" + std::to_string(number));
  }
};

/// What a diagnosis says, for the record.
void take_in(Round& round, const identify::Study& study);

/// What there is to be said when `round` is the last: nullopt when a further experiment is called for.
[[nodiscard]] std::optional<Outcome> settled_by(const Round& round);
/// The answer in words.
[[nodiscard]] std::string answer_text(const Investigation& all);

/// investigation.json, through a temporary name.
void save(const Investigation& all);
/// Rounds that an earlier process recorded. Throws std::runtime_error when the folder holds something else, or
/// an investigation with other inputs.
void load(Investigation& all);

/// investigation-report.html: every round, what was tied, which experiment was chosen and why, and what it settled.
void write_report(const Investigation& all, const identify::report::Made& made);

}  // namespace isorig::cli
