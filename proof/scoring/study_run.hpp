#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/campaign/plan.hpp"
#include "cli/campaign/slurm.hpp"
#include "proof/scoring/runner.hpp"

/// Every case of a study as a piece of a campaign (docs/campaign.md): cli/campaign runs `isorig-proof case` for each,
/// here or on Slurm, and runs none twice.
namespace isorig::proof {

/// How cases are run.
struct StudyCall {
  RunOptions each;
  unsigned retries = 1;  ///< of a case that failed
  std::string on = "local";
  cli::pieces::SlurmOptions slurm{};
};

/// Which program with which bytes answers: what a study's results are results of.
[[nodiscard]] std::string judged_program(const std::filesystem::path& isorig);

/// Every case that is not there, into RESULTS/NAME. `list` names them with their nominal models, as cases.json does.
/// Says on standard output how it ended and on standard error what failed: a case that failed is one that score counts.
/// Throws std::runtime_error when it could not go on; a signal ends this process.
void run_cases(const std::vector<CaseToRun>& cases, const std::filesystem::path& list,
               const std::filesystem::path& results, const StudyCall& call);

/// One task of a job array of run_cases(). Throws std::runtime_error when it could not go on.
void run_task(const std::filesystem::path& results, const std::filesystem::path& list, cli::pieces::Share share);

/// What run_cases() left in a folder.
class StudyResults {
 public:
  explicit StudyResults(std::filesystem::path folder);

  /// Of the case with that name, its predictions compared with `reference_N`. One that the newest call did not come to
  /// has failed; so has one that an earlier call made with another program or other options.
  [[nodiscard]] bool tried(const std::string& name) const;  ///< it was answered or has failed
  [[nodiscard]] Outcome outcome(const std::string& name, const std::vector<double>& reference_N) const;

 private:
  std::filesystem::path folder_;
  std::optional<cli::pieces::Plan> plan_;  ///< none of a version that kept no plan
};

}  // namespace isorig::proof
