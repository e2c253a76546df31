#include <cstdio>
#include <memory>

#include "base/process.hpp"
#include "proof/commands.hpp"
#include "proof/real/convert.hpp"
#include "proof/scoring/runner.hpp"

namespace isorig::proof {
namespace {

struct Options {
  std::filesystem::path source;
  std::filesystem::path out;
  std::filesystem::path isorig = "isorig";
  std::string only;
  bool run = true;
};

void tell(const RealCase& real, const Options& options) {
  const std::filesystem::path folder = options.out / real.name;
  write_real_case(real, options.source, folder);
  std::printf("%s\n  left out: %s\n  known:    %s\n", real.name.data(), real.left_out.data(), real.known.data());
  if (!options.run) return;
  std::filesystem::remove(folder / "log.txt");
  std::vector<std::string> command{options.isorig, "diagnose"};
  for (std::size_t i = 0; i < real.files.size(); ++i) command.push_back(folder / recording_name(real, i));
  command.insert(command.end(), {"--model", folder / "nominal.toml", "--out", folder / "diagnosis"});
  const base::ProcessResult result = base::run_process(command, folder / "log.txt");
  if (result.exit_code != 0) {
    std::printf("  failed:   exit code %d, %s\n", result.exit_code, (folder / "log.txt").c_str());
    return;
  }
  const Outcome outcome = read_diagnosis(folder / "diagnosis" / "diagnosis.json");
  std::printf("  found:    %s", outcome.verdict.c_str());
  for (const Claim& claim : outcome.missing) std::printf(", %s %.2f", claim.effect.c_str(), claim.probability);
  std::printf(" (%.1f s)\n", result.wall_s);
}

}  // namespace

void add_real(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub =
      app.add_subcommand("real", "Real recordings of others, with a known effect left out of the nominal model");
  sub->add_option("SOURCE", options->source, "Folder of the recordings")->required()->check(CLI::ExistingDirectory);
  sub->add_option("--out", options->out, "Folder for what is converted and found")->required();
  sub->add_option("--isorig", options->isorig, "The program to judge")->capture_default_str();
  sub->add_option("--only", options->only, "One of: emps, pendulum, elastomer, silicone, festo, cylinder");
  sub->add_flag("--run,!--convert-only", options->run, "Diagnose what was converted");
  sub->callback([options] {
    for (const RealCase& real : real_cases())
      if (options->only.empty() || options->only == real.name) tell(real, *options);
  });
}

}  // namespace isorig::proof
