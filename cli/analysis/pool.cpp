#include "identify/pooling/pool.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

#include "base/lock_file.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"

namespace isorig::cli {
namespace {

namespace pooling = identify::pooling;

struct PoolOptions {
  std::vector<std::string> diagnoses;
  std::string out;
  unsigned threads = 2;
};

int pool(const PoolOptions& options) {
  for (const char* file : {"plan.json", "campaign.json"})
    if (std::filesystem::exists(std::filesystem::path(options.out) / file)) {
      std::cerr << options.out << ": holds what `isorig campaign` wrote, whose page this would replace; name another "
                << "folder with --out\n";
      return kUsage;
    }
  const base::FolderLock alone(options.out);
  std::vector<pooling::Source> sources;
  for (const std::string& folder : options.diagnoses) sources.push_back({folder});
  try {
    const auto pooled = pooling::pool(sources, {.threads = options.threads});
    pooling::write_pooled(pooled, options.out,
                          made_by_this_call({{"Diagnoses", std::to_string(options.diagnoses.size()) + " folders"}}));
    for (const std::string& finding : pooled.findings) std::printf("%s\n", finding.c_str());
  } catch (const pooling::PoolError& e) {
    std::cerr << e.what() << '\n';
    return kBadInput;
  } catch (const std::filesystem::filesystem_error& e) {
    std::cerr << options.out << ": cannot be written (" << e.code().message() << "); name another folder with --out\n";
    return kFailure;
  }
  std::printf("written to %s\n", options.out.c_str());
  return kOk;
}

Command add_pool(CLI::App& app) {
  auto options = std::make_shared<PoolOptions>();
  auto* sub = app.add_subcommand(
      "pool",
      "Diagnoses of a whole campaign as one: what all actuators share, what grows with pressure, who does not belong");
  sub->add_option("FOLDER", options->diagnoses, "Folders that `isorig diagnose` wrote, one for each recording")
      ->required();
  sub->add_option("--out", options->out, "Folder for campaign-report.html and pooled.json")->required();
  sub->add_option("--threads", options->threads, "Threads to use")->capture_default_str()->check(CLI::Range(1, 64));
  return {sub, [options] { return pool(*options); }};
}

const Registration kPool(42, add_pool);

}  // namespace
}  // namespace isorig::cli
