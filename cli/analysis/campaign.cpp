#include "identify/fv/campaign.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "base/formatted.hpp"
#include "cli/analysis/analyse_recordings.hpp"
#include "cli/analysis/campaign_pieces.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"

namespace isorig::cli {
namespace {

struct CampaignOptions {
  PiecesOptions pieces;  ///< recordings and folder of the paper's figures too
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

int paper_figures(const PiecesOptions& options, const std::string& simulated) {
  if (options.recordings.empty()) {
    std::cerr << "isorig campaign: name the recordings; --list goes with --ask alone\n";
    return kUsage;
  }
  const std::filesystem::path out = options.out;
  const bool of_pieces = std::filesystem::exists(out / "plan.json") || std::filesystem::exists(out / "pieces");
  if (of_pieces || std::filesystem::exists(out / "pooled.json")) {
    std::cerr << options.out << (of_pieces ? ": holds a campaign of --ask" : ": holds what `isorig pool` wrote")
              << ", which this would replace; name another folder with --out\n";
    return kUsage;
  }
  identify::FvOptions of_each;
  of_each.whole_series = of_each.history = false;  // hundreds of recordings; `isorig fv` does it for any one of them
  constexpr double kReadShare = 0.6;
  auto [results, exit_code, left_out] =
      analyse_recordings("campaign", options.recordings, kReadShare, of_each, {}, Unreadable::kLeaveOut);
  if (exit_code != kOk) return exit_code;
  identify::Campaign found;
  try {
    found = identify::analyse_campaign(std::move(results));
  } catch (const std::invalid_argument& e) {
    std::cerr << "isorig campaign: " << e.what() << '\n';
    return kBadInput;
  }
  found.left_out = std::move(left_out);
  identify::write_campaign_report(
      found, options.out, simulated,
      made_by_this_call({{"Recordings", std::to_string(options.recordings.size()) + " folders"},
                         {"In", common_folder(options.recordings)}}));
  std::printf("%zu fits, R² %.3f ± %.3f (mean and standard deviation)\n", found.fits, found.r_squared_mean,
              found.r_squared_sd);
  if (!found.trends.empty()) std::printf("trends of the paper, and in how many cases they hold here:\n");
  for (const auto& t : found.trends)
    std::printf("  %s  %s\n", t.of == 0 ? "no case   " : base::formatted("%3d of %3d", t.holds, t.of).c_str(),
                t.claim.c_str());
  std::printf("written to %s\n", options.out.c_str());
  if (!found.left_out.empty())
    std::cerr << base::formatted("isorig campaign: %zu of %zu recordings cannot be read, and are left out\n",
                                 found.left_out.size(), options.recordings.size());
  if (found.fits == 0) return kFailure;
  return found.left_out.empty() ? kOk : kBadInput;
}

Command add_campaign(CLI::App& app) {
  auto options = std::make_shared<CampaignOptions>();
  auto* sub = app.add_subcommand("campaign",
                                 "The paper's figures, tables and trends from the recordings of a whole campaign; with "
                                 "--ask, a diagnosis or analysis of each of very many recordings");
  auto& pieces = options->pieces;
  sub->add_option("RECORDING", pieces.recordings, "Folders of recordings, all specimens and pressures");
  sub->add_option("--out", pieces.out, "Folder for campaign-report.html, campaign.json and tables")->required();
  sub->add_option("--simulated", options->simulated,
                  "What is simulated in these recordings, for the top of the report");
  auto* ask = sub->add_option("--ask", pieces.ask, "Run this command on each recording by itself, as a piece");
  ask->check(CLI::IsMember({"diagnose", "fv"}));
  const auto with_ask = [&](CLI::Option* option) { return option->needs(ask); };
  with_ask(sub->add_option("--list", pieces.list, "File with the path of a recording on each line; -: standard input"));
  with_ask(sub->add_option("--model", pieces.model, "Nominal model: slse1, slse2 or a TOML file"))
      ->capture_default_str();
  with_ask(sub->add_option("--control", pieces.control,
                           "fv.json of the control actuators: with --model slse2, sheaths are fitted on their control, "
                           "Ecoflex1 on Control1"));
  with_ask(sub->add_option("-j,--jobs", pieces.jobs, "Pieces at a time (default: one per processor)"))
      ->check(CLI::Range(1, 1024));
  with_ask(sub->add_option("--threads", pieces.threads, "Threads of each diagnosis"))
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  with_ask(sub->add_option("--retries", pieces.retries, "How often a piece that failed is repeated"))
      ->capture_default_str()
      ->check(CLI::Range(0, 100));
  with_ask(sub->add_option("--on", pieces.on, "Where the pieces are made"))
      ->capture_default_str()
      ->check(CLI::IsMember({"local", "slurm"}));
  with_ask(sub->add_option("--slurm-options", pieces.slurm.more, "Further options of sbatch, in quotes"));
  with_ask(sub->add_option("--per-task", pieces.slurm.per_task, "Recordings of one Slurm task, at least"))
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  return {sub, [options] {
            return options->pieces.ask.empty() ? paper_figures(options->pieces, options->simulated)
                                               : campaign_of_pieces(options->pieces);
          }};
}

const Registration kCampaign(40, add_campaign);

}  // namespace
}  // namespace isorig::cli
