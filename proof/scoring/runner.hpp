#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

struct RunOptions {
  std::filesystem::path isorig = "isorig";
  unsigned jobs = 1;
  unsigned threads = 2;  ///< of each diagnosis
};

struct CaseToRun {
  std::string name;
  std::string nominal;  ///< slse1, slse2 or a file
  std::filesystem::path train;
  std::filesystem::path heldout;
};

/// `isorig diagnose` on train, then `isorig predict` of both models on heldout: into RESULTS/name. What was
/// measured about the run goes to RESULTS/name/run.json. `heldout` is handed over without its forces.
void run_cases(const std::vector<CaseToRun>& cases, const std::filesystem::path& results, const RunOptions& options);

/// What run_cases left for a case, its predictions compared with `reference_N`.
[[nodiscard]] Outcome collect(const std::filesystem::path& folder, const std::vector<double>& reference_N);

}  // namespace isorig::proof
