#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

struct RunOptions {
  std::filesystem::path isorig = "isorig";
  unsigned jobs = 1;
  unsigned threads = 2;             ///< of each diagnosis
  std::vector<std::string> also{};  ///< further arguments of each diagnosis
};

struct CaseToRun {
  std::string name;
  std::string nominal;  ///< slse1, slse2 or a file
  std::filesystem::path train;
  std::filesystem::path heldout;
};

/// `isorig diagnose` on train, then `isorig predict` of both models on heldout: into `folder`, which is emptied first.
/// What was measured about the run goes to run.json there. `heldout` is handed over without its forces.
void run_case(const CaseToRun& one, const std::filesystem::path& folder, const RunOptions& options);
/// Every case, into RESULTS/name.
void run_cases(const std::vector<CaseToRun>& cases, const std::filesystem::path& results, const RunOptions& options);

/// The cases of a study's folder.
[[nodiscard]] std::vector<CaseToRun> cases_of(const std::filesystem::path& study);

/// A noise-free force beside sealed labels; throws std::runtime_error where it is not the one that they name.
[[nodiscard]] std::vector<double> true_force_N(const std::filesystem::path& labels_file, const Label& label);

/// What run_case left for a case, its predictions compared with `reference_N`.
[[nodiscard]] Outcome collect(const std::filesystem::path& folder, const std::vector<double>& reference_N);

}  // namespace isorig::proof
