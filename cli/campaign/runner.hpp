#pragma once
#include <functional>
#include <iosfwd>
#include <optional>
#include <string>

#include "cli/campaign/merge.hpp"
#include "cli/campaign/plan.hpp"
#include "cli/campaign/slurm.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {

struct CampaignCall {
  Plan plan;
  Named named;
  std::filesystem::path program;  ///< isorig, for the pieces
  unsigned jobs = 1;
  unsigned retries = 1;  ///< of a piece that failed
  std::optional<SlurmOptions> slurm{};
  identify::report::Made made{};
};

struct CampaignEnd {
  Standing standing;
  int stopped_by = 0;     ///< a signal; the same call goes on
  std::string stopped{};  ///< why else it is incomplete, or what goes on without it
};

/// Makes all pieces that are not there, merging as they come. Throws PlanError and SlurmError.
[[nodiscard]] CampaignEnd run_campaign(const CampaignCall& call, std::istream& standard_input);

/// A line for each that failed, with where its log lies; of many, the first ones.
void print_failed(const Plan& plan, std::ostream& out);

/// One task of an array: its share of a list, a line on `out` for each recording. The plan is that of the folder.
/// Throws PlanError: another program than the campaign's.
[[nodiscard]] Done run_task(const std::filesystem::path& folder, const std::filesystem::path& list, Share share,
                            const std::filesystem::path& program, const std::string& version, std::ostream& out);

}  // namespace isorig::cli::pieces
