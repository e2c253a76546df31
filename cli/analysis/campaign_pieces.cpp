#include "cli/analysis/campaign_pieces.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <thread>

#include "base/printable.hpp"
#include "cli/analysis/diagnosis_files.hpp"
#include "cli/campaign/control.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"

namespace isorig::cli {
namespace {

namespace fs = std::filesystem;

fs::path this_program() {
  return fs::read_symlink("/proc/self/exe");
}

int ended(const pieces::CampaignCall& call, const pieces::CampaignEnd& end) {
  const pieces::Standing& s = end.standing;
  if (s.stopped) {
    std::cerr << "isorig campaign: interrupted while the tables were written; what is made stays, and the same command "
                 "writes them\n";
    if (!end.stopped.empty()) std::cerr << "isorig campaign: " << end.stopped << '\n';
    pieces::die_of(end.stopped_by);
  }
  if (s.failed > 0) pieces::print_failed(call.plan, std::cerr);
  std::printf("%zu of %zu recordings answered", s.made, s.recordings);
  if (s.bad > 0) std::printf(", %zu of them unreadable", s.bad);
  if (s.failed > 0) std::printf("; %zu failed", s.failed);
  if (s.waiting() > 0) std::printf("; %zu not made yet", s.waiting());
  std::printf("\n");
  for (const auto& [verdict, count] : s.verdicts) std::printf("  %zu %s\n", count, verdict.c_str());
  for (const std::string& finding : s.findings) std::printf("%s\n", finding.c_str());
  std::printf("written to %s\n", call.plan.folder.c_str());
  std::fflush(stdout);
  if (!end.stopped.empty()) std::cerr << "isorig campaign: " << end.stopped << '\n';
  if (end.stopped_by != 0) {
    if (end.stopped.empty()) std::cerr << "isorig campaign: interrupted; the same command goes on with what is left\n";
    pieces::die_of(end.stopped_by);
  }
  if (s.failed > 0 || s.waiting() > 0) return kFailure;
  return s.bad > 0 ? kBadInput : kOk;
}

/// Why this question cannot be asked with this model; empty where it can.
std::string wrong_with_model(const PiecesOptions& options) {
  const bool sheaths = options.ask == "fv" && options.model == "slse2";
  if (options.ask == "fv" && options.model != "slse1" && !sheaths)
    return "--ask fv fits slse1, or slse2 with --control FV.json";
  if (sheaths && options.control.empty())
    return "--ask fv --model slse2 needs --control FV.json: what `isorig fv` made of the control actuators";
  if (!sheaths && !options.control.empty()) return "--control goes with --ask fv --model slse2 alone";
  return "";
}

struct TaskOptions {
  std::string folder, list;
  pieces::Share share;
};

int task(const TaskOptions& options) {
  const pieces::Done done =
      pieces::run_task(options.folder, options.list, options.share, this_program(), version_and_revision(), std::cout);
  if (!done.cannot_go_on.empty()) std::cerr << done.cannot_go_on << '\n';
  if (done.stopped_by != 0) pieces::die_of(done.stopped_by);
  return done.cannot_go_on.empty() ? kOk : kFailure;
}

Command add_task(CLI::App& app) {
  auto options = std::make_shared<TaskOptions>();
  auto* sub = app.add_subcommand("campaign-pieces", "One task of a campaign's job array (isorig campaign --on slurm)");
  sub->group("");
  sub->add_option("DIR", options->folder, "The campaign's folder")->required();
  sub->add_option("--list", options->list, "Recordings of the array")->required();
  sub->add_option("--task", options->share.task, "Which task this is")->required();
  sub->add_option("--of", options->share.of, "How many there are")->required()->check(CLI::PositiveNumber);
  return {sub, [options] { return task(*options); }};
}

const Registration kTask(46, add_task);

}  // namespace

int campaign_of_pieces(const PiecesOptions& options) {
  pieces::CampaignCall call;
  const bool is_file = options.model != "slse1" && options.model != "slse2";
  if (const std::string wrong = wrong_with_model(options); !wrong.empty()) {
    std::cerr << "isorig campaign: " << wrong << '\n';
    return kUsage;
  }
  if (options.ask == "diagnose") (void)read_nominal(options.model);  // what is wrong with it is said once, and now
  call.plan = {fs::path(pieces::plan_path(options.out)),
               {.command = options.ask,
                .model = is_file ? pieces::plan_path(options.model) : options.model,
                .threads = options.threads,
                .control = options.control.empty() ? "" : pieces::plan_path(options.control)},
               version_and_revision()};
  try {
    (void)pieces::controls_of(call.plan.ask);
  } catch (const std::runtime_error& e) {
    std::cerr << base::printable_lines(e.what()) << '\n';
    return kBadInput;
  }
  call.named = {options.recordings, options.list};
  call.program = this_program();
  call.jobs = options.jobs > 0 ? options.jobs : std::max(1U, std::thread::hardware_concurrency());
  call.retries = options.retries;
  if (options.on == "slurm") call.slurm = options.slurm;
  call.made = made_by_this_call(
      {{"Recordings", options.list.empty() ? std::to_string(options.recordings.size()) + " folders" : options.list},
       {"Model", call.plan.ask.model}});
  try {
    return ended(call, pieces::run_campaign(call, std::cin));
  } catch (const pieces::PlanUnwritable& e) {
    std::cerr << "isorig campaign: " << base::printable_lines(e.what()) << '\n';
    return kFailure;
  } catch (const pieces::PlanError& e) {
    std::cerr << "isorig campaign: " << base::printable_lines(e.what()) << '\n';
    return kUsage;
  } catch (const pieces::SlurmError& e) {
    std::cerr << "isorig campaign: " << base::printable_lines(e.what()) << '\n';
    return kFailure;
  }
}

}  // namespace isorig::cli
