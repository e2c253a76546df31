#include "proof/scoring/study_run.hpp"

#include <cstdio>
#include <iostream>
#include <sstream>
#include <stdexcept>

#include "cli/campaign/piece.hpp"
#include "cli/campaign/runner.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;
namespace pieces = cli::pieces;

fs::path this_program() {
  return fs::read_symlink("/proc/self/exe");
}

}  // namespace

std::string judged_program(const fs::path& isorig) {
  return "isorig with SHA-256 " + pieces::sha256_of_file(isorig);
}

void run_cases(const std::vector<CaseToRun>& cases, const fs::path& list, const fs::path& results,
               const StudyCall& call) {
  std::error_code none;
  if (!cases.empty() && fs::equivalent(results, cases.front().train.parent_path().parent_path(), none))
    throw std::runtime_error(results.string() +
                             ": the cases themselves lie there, and results would replace them; name another folder");
  pieces::CampaignCall campaign;
  const fs::path judged = path_of(call.each.isorig);
  campaign.plan.folder = pieces::plan_path(results);
  campaign.plan.ask = {.command = "case",
                       .model = pieces::plan_path(list),
                       .threads = call.each.threads,
                       .judged = judged.string(),
                       .options = call.each.also};
  campaign.plan.program = judged_program(judged);
  for (const CaseToRun& one : cases) campaign.named.recordings.push_back(one.train.parent_path());
  campaign.program = this_program();
  campaign.jobs = call.each.jobs;
  campaign.retries = call.retries;
  if (call.on == "slurm") campaign.slurm = call.slurm;
  campaign.made.command = "isorig-proof";
  campaign.made.version = campaign.plan.program;
  std::istringstream nothing;
  const pieces::CampaignEnd end = pieces::run_campaign(campaign, nothing);
  const pieces::Standing& s = end.standing;
  if (s.stopped) {
    std::cerr << "isorig-proof: interrupted while the tables were written; what is run stays, and the same command "
                 "writes them\n";
    if (!end.stopped.empty()) std::cerr << "isorig-proof: " << end.stopped << '\n';
    pieces::die_of(end.stopped_by);
  }
  if (s.failed > 0) pieces::print_failed(campaign.plan, std::cerr);
  std::printf("%zu of %zu cases answered", s.made, s.recordings);
  if (s.failed > 0) std::printf("; %zu failed", s.failed);
  if (s.waiting() > 0) std::printf("; %zu not run yet", s.waiting());
  std::printf("\nwritten to %s\n", campaign.plan.folder.c_str());
  std::fflush(stdout);
  if (end.stopped_by != 0) {
    std::cerr << "isorig-proof: "
              << (end.stopped.empty() ? "interrupted; the same command goes on with what is left" : end.stopped)
              << '\n';
    pieces::die_of(end.stopped_by);
  }
  if (s.waiting() > 0 || !end.stopped.empty())
    throw std::runtime_error("isorig-proof: " + (end.stopped.empty() ? "not all cases were run" : end.stopped));
}

void run_task(const fs::path& results, const fs::path& list, pieces::Share share) {
  const pieces::Plan plan = pieces::read_plan(results);
  const pieces::Done done =
      pieces::run_task(results, list, share, this_program(), judged_program(plan.ask.judged), std::cout);
  if (done.stopped_by != 0) pieces::die_of(done.stopped_by);
  if (!done.cannot_go_on.empty()) throw std::runtime_error(done.cannot_go_on);
}

StudyResults::StudyResults(fs::path folder) : folder_(std::move(folder)) {
  if (fs::exists(folder_ / "plan.json")) plan_ = pieces::read_plan(folder_);
}

bool StudyResults::tried(const std::string& name) const {
  if (!plan_) return fs::exists(folder_ / name / "run.json");
  return pieces::made_as_planned(*plan_, name) || fs::exists(pieces::failed_folder(*plan_, name) / "failure.json");
}

Outcome StudyResults::outcome(const std::string& name, const std::vector<double>& reference_N) const {
  Outcome none;
  none.failed = true;
  if (!tried(name)) {
    none.why = "not run yet with the newest call's program and options";
    return none;
  }
  if (!plan_ || pieces::made_as_planned(*plan_, name)) return collect(folder_ / name, reference_N);
  const fs::path failed = pieces::failed_folder(*plan_, name);
  if (fs::exists(failed / "run.json")) return collect(failed, reference_N);
  none.why = "it ended before its diagnosis did: " + failed.string();
  return none;
}

}  // namespace isorig::proof
