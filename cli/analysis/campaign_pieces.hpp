#pragma once
#include <string>
#include <vector>

#include "cli/campaign/runner.hpp"

namespace isorig::cli {

/// What `isorig campaign --ask` is called with.
struct PiecesOptions {
  std::vector<std::string> recordings;
  std::string list, out, ask, model = "slse1", control, on = "local";
  unsigned jobs = 0;  ///< 0: one per processor
  unsigned threads = 1, retries = 1;
  pieces::SlurmOptions slurm;
};

/// Asks every recording, and says how it ended. An exit code.
int campaign_of_pieces(const PiecesOptions& options);

}  // namespace isorig::cli
