#include <map>
#include <memory>
#include <random>

#include "proof/commands.hpp"
#include "proof/generator/unfinished.hpp"

namespace isorig::proof {

void add_generate(CLI::App& app) {
  auto options = std::make_shared<StudyOptions>();
  auto seed = std::make_shared<std::optional<std::uint64_t>>();
  auto* sub = app.add_subcommand(
      "generate", "Draw cases, write their recordings, seal their labels; what is written is not made again");
  sub->add_option("--seed", *seed, "Equal seeds give equal studies; without one, nobody knows it beforehand");
  sub->add_option("--cases", options->cases, "Number of cases")->capture_default_str()->check(CLI::Range(1, 100'000));
  sub->add_option("--out", options->out, "Folder of the study")->required();
  sub->add_option("-j,--jobs", options->threads, "Cases at a time")->capture_default_str()->check(CLI::Range(1, 64));
  const std::map<std::string, Laws> laws{{"catalogue", Laws::kCatalogue}, {"foreign", Laws::kForeign}};
  sub->add_option("--laws", options->laws, "Whose formulas: those of the catalogue, or others (docs/proof.md)")
      ->transform(CLI::CheckedTransformer(laws, CLI::ignore_case))
      ->default_str("catalogue");
  sub->callback([options, seed] {
    if (!*seed) *seed = unfinished_seed(*options);
    if (!*seed) {
      std::random_device device;
      *seed = (static_cast<std::uint64_t>(device()) << 32) | device();
    }
    options->seed = **seed;
    const std::string hash = generate_study(*options);
    std::printf("%zu cases in %s\nSHA-256 of the sealed labels: %s\n", options->cases, options->out.c_str(),
                hash.c_str());
  });
}

}  // namespace isorig::proof
