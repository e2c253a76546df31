#include "identify/fv/campaign.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "base/formatted.hpp"
#include "cli/analysis/analyse_recordings.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"

namespace isorig::cli {
namespace {

struct Options {
  std::vector<std::string> recordings;
  std::string out;
  std::string simulated;
};

/// The folder that all of them lie in: hundreds of names would hide the page's foot.
std::string common_folder(const std::vector<std::string>& recordings) {
  std::filesystem::path common;
  for (const std::string& each : recordings) {
    const auto folder = std::filesystem::absolute(each).lexically_normal();
    if (common.empty()) common = folder.parent_path();
    std::filesystem::path shared;
    for (auto a = common.begin(), b = folder.begin(); a != common.end() && b != folder.end() && *a == *b; ++a, ++b)
      shared /= *a;
    common = shared;
  }
  return common.string();
}

int campaign(const Options& options) {
  identify::FvOptions of_each;
  of_each.whole_series = of_each.history = false;  // hundreds of recordings; `isorig fv` does it for any one of them
  constexpr double kReadShare = 0.6;
  auto [results, exit_code] = analyse_recordings("campaign", options.recordings, kReadShare, of_each);
  if (exit_code != kOk) return exit_code;
  identify::Campaign found;
  try {
    found = identify::analyse_campaign(std::move(results));
  } catch (const std::invalid_argument& e) {
    std::cerr << "isorig campaign: " << e.what() << '\n';
    return kBadInput;
  }
  identify::write_campaign_report(
      found, options.out, options.simulated,
      made_by_this_call({{"Recordings", std::to_string(options.recordings.size()) + " folders"},
                         {"In", common_folder(options.recordings)}}));
  std::printf("%zu fits, R² %.3f ± %.3f (mean and standard deviation)\n", found.fits, found.r_squared_mean,
              found.r_squared_sd);
  if (!found.trends.empty()) std::printf("trends of the paper, and in how many cases they hold here:\n");
  for (const auto& t : found.trends)
    std::printf("  %s  %s\n", t.of == 0 ? "no case   " : base::formatted("%3d of %3d", t.holds, t.of).c_str(),
                t.claim.c_str());
  std::printf("written to %s\n", options.out.c_str());
  return found.fits > 0 ? kOk : kFailure;
}

Command add_campaign(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand(
      "campaign", "The paper's figures, tables and trends from the recordings of a whole campaign (proof/campaign)");
  sub->add_option("RECORDING", options->recordings, "Recordings of Control<n> and <material><n>, all pressures")
      ->required();
  sub->add_option("--out", options->out, "Folder for campaign-report.html, campaign.json and tables")->required();
  sub->add_option("--simulated", options->simulated,
                  "What is simulated in these recordings, for the top of the report");
  return {sub, [options] { return campaign(*options); }};
}

const Registration kCampaign(31, add_campaign);

}  // namespace
}  // namespace isorig::cli
