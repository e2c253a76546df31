#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "proof/commands.hpp"
#include "proof/real/study.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

struct Paths {
  std::filesystem::path source;
  std::filesystem::path out;
  std::vector<std::string> only;
  RealOptions run;
  bool diagnose = true;
};

std::vector<RealCase> chosen(const std::vector<std::string>& only) {
  const auto is = [](const RealCase& real, const std::string& name) { return name == real.name || name == real.set; };
  for (const std::string& name : only) {
    if (std::ranges::any_of(real_cases(), [&](const RealCase& real) { return is(real, name); })) continue;
    std::string said = "--only " + name + ": no case; there are the folders of the recordings and";
    for (const RealCase& real : real_cases()) said.append(" ").append(real.name);
    throw std::runtime_error(said);
  }
  std::vector<RealCase> out;
  for (const RealCase& real : real_cases())
    if (only.empty() || std::ranges::any_of(only, [&](const std::string& name) { return is(real, name); }))
      out.push_back(real);
  return out;
}

}  // namespace

void add_real(CLI::App& app) {
  auto paths = std::make_shared<Paths>();
  auto* sub =
      app.add_subcommand("real", "Real recordings of others, with a known effect left out of the nominal model");
  sub->add_option("SOURCE", paths->source, "Folder of the recordings")->required()->check(CLI::ExistingDirectory);
  sub->add_option("--out", paths->out, "Folder for what is converted and found")->required();
  sub->add_option("--isorig", paths->run.isorig, "The program to judge")->capture_default_str();
  sub->add_option("--only", paths->only, "Cases, or folders of the recordings");
  sub->add_option("-j,--jobs", paths->run.jobs, "Cases at a time")->capture_default_str();
  sub->add_option("--threads", paths->run.threads, "Threads of each diagnosis")->capture_default_str();
  sub->add_flag("--run,!--convert-only", paths->diagnose, "Diagnose what was converted");
  sub->callback([paths] {
    const auto cases = chosen(paths->only);
    std::error_code none;
    if (std::filesystem::equivalent(paths->source, paths->out, none))
      throw std::runtime_error("--out is the folder of the recordings themselves; name another one");
    if (!paths->diagnose) {
      for (const RealCase& real : cases) write_real_case(real, paths->source, paths->out / real.name);
      return;
    }
    const auto outcomes = run_real_cases(cases, paths->source, paths->out, paths->run);
    const std::string text = real_markdown(cases, outcomes);
    write_text(paths->out / "real.md", text);
    write_text(paths->out / "real.json", real_json(cases, outcomes).dump(2) + "\n");
    std::printf("%s\n%s\n", text.c_str(), (paths->out / "real.md").c_str());
    if (std::ranges::any_of(outcomes, [](const RealOutcome& o) { return o.said.failed; }))
      throw std::runtime_error("not every case could be diagnosed and predicted; OUT/CASE/log.txt says why");
  });
}

}  // namespace isorig::proof
