#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

struct RunOptions {
  std::filesystem::path isorig = "isorig";
  unsigned jobs = 1;
  unsigned threads = 2;             ///< of each diagnosis; changes no result
  std::vector<std::string> also{};  ///< further arguments of each diagnosis
};

struct CaseToRun {
  std::string name;
  std::string nominal;  ///< slse1, slse2 or a file
  std::filesystem::path train;
  std::filesystem::path heldout;
};

/// Where the program is; one that is named without a folder is looked for on PATH. Throws std::runtime_error.
[[nodiscard]] std::filesystem::path path_of(const std::filesystem::path& program);

/// `isorig diagnose` on train, then `isorig predict` of both models on heldout: into `folder`. What was measured about
/// the diagnosis goes to run.json there. `heldout` is handed over without its forces. Children die with this process.
/// Returns what failed, "" where nothing did.
std::string run_case(const CaseToRun& one, const std::filesystem::path& folder, const RunOptions& options);

/// The cases of a study's folder.
[[nodiscard]] std::vector<CaseToRun> cases_of(const std::filesystem::path& study);
/// The case in that folder, with the nominal model that a list like a study's cases.json has for it.
[[nodiscard]] CaseToRun case_in(const std::filesystem::path& folder, const std::filesystem::path& list);

/// A noise-free force beside sealed labels; throws std::runtime_error where it is not the one that they name.
[[nodiscard]] std::vector<double> true_force_N(const std::filesystem::path& labels_file, const Label& label);

/// What run_case left for a case, its predictions compared with `reference_N`.
[[nodiscard]] Outcome collect(const std::filesystem::path& folder, const std::vector<double>& reference_N);

}  // namespace isorig::proof
