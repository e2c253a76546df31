#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <set>

#include "base/fingerprint.hpp"
#include "base/lock_file.hpp"
#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "cli/analysis/diagnosis_files.hpp"
#include "cli/analysis/investigation.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/provenance.hpp"
#include "cli/screen/progress.hpp"
#include "daemon/export/export.hpp"
#include "daemon/host/virtual_run.hpp"
#include "identify/diagnose/design/candidates.hpp"
#include "identify/report/page.hpp"
#include "messages/recording.hpp"
#include "model/words.hpp"
#include "protocol/compile.hpp"

/// isorig investigate: run, diagnose, design the experiment that separates what is tied, run it, and so on until
/// one explanation stands out.
namespace isorig::cli {
namespace {

struct InvestigateOptions {
  std::string rig, protocol, out;
  std::string model = "slse1";
  int rounds = 4;
  double budget_s = 4.0 * 3600.0;
  double pressure_psi = 0.0;
  std::uint64_t seed = 0;
  bool has_seed = false;
  unsigned threads = 2;
  bool report = true;
};

/// Whoever names no protocol gets the paper's ramps in short: two speeds, both ways, with rests.
std::string first_look(const daemon::RigConfig& rig, double pressure_psi) {
  identify::CandidateLimits limits;
  limits.rig = rig.limits;
  limits.nominal_psi = pressure_psi;
  const double room_mm = 0.4 * std::min(-rig.limits.travel_min_mm, rig.limits.travel_max_mm);
  const double stroke_mm = std::min(pressure_psi < 10.0 ? 1.0 : 2.0, room_mm);
  std::string body;
  for (const double speed : {0.2, 0.8})
    body += identify::paper_ramps(stroke_mm, std::min(speed * rig.limits.speed_max_mm_s, 10.0),
                                  std::max(0.05, rig.limits.speed_min_mm_s));
  return identify::protocol_text(identify::session_of("first look", body, limits), limits, "first-look",
                                 "The paper's ramps in short, to begin an investigation with");
}

class Loop {
 public:
  explicit Loop(const InvestigateOptions& options) : options_(options), rig_(daemon::load_rig(options.rig)) {}

  int run() {
    if (!rig_.simulated()) return refuse_real();
    nominal_ = read_nominal(options_.model);
    read_first_protocol();
    all_.folder = options_.out;
    std::filesystem::create_directories(all_.folder);
    const base::LockFile alone(all_.folder / "investigation.lock");  // a second call would begin the same round
    std::string physics;
    if (rig_.sim->physics) physics = model::model_text(rig_.sim->physics->spec);
    all_.inputs = {{"rig", rig_.name},
                   {"rig_text", base::fingerprint(rig_.text + physics)},
                   {"model", nominal_.name},
                   {"model_text", base::fingerprint(model::model_text(nominal_))},
                   {"protocol_text", base::fingerprint(first_protocol_)},
                   {"pressure_psi", pressure_psi_},
                   {"seed", seed()}};
    load(all_);
    std::printf("rig %s, model %s, at most %d rounds; into %s/\n", rig_.name.c_str(), nominal_.name.c_str(),
                options_.rounds, options_.out.c_str());
    for (int number = 1;; ++number) {
      Round* round = have(number);
      const bool was_run = round != nullptr;
      if (!was_run) {
        if (const int code = make(number); code != kOk) return code;
        round = &all_.rounds.back();
      }
      std::printf("Round %d: %s; %s of rig time%s\n", number, round->text.c_str(), duration_text(round->rig_s).c_str(),
                  was_run ? ", recorded before" : "");
      std::fflush(stdout);
      if (!round->diagnosed && !diagnose(*round)) return kBadInput;
      say(*round);
      if (const auto outcome = ended_by(*round)) return finish(*outcome);
    }
  }

 private:
  int refuse_real() {
    std::cerr << "isorig investigate: " << options_.rig
              << " has devices on the wire, and nobody but you starts those. One round by hand:\n"
                 "  isorig start PROTOCOL && isorig export latest --out RECORDINGS\n"
                 "  isorig diagnose RECORDINGS/* --model "
              << options_.model << " --rig " << options_.rig << " --out " << options_.out
              << "\nIf explanations are tied, PROTOCOL of the next round is " << options_.out
              << "/next_experiment.toml; give all recordings to the next diagnosis together.\n";
    return kUsage;
  }

  /// Of the reports: from which rig, model and recordings.
  [[nodiscard]] identify::report::Made provenance() const {
    std::vector<std::pair<std::string, std::string>> inputs{{"Rig", options_.rig}, {"Nominal model", options_.model}};
    for (const Round& round : all_.rounds)
      for (const std::string& folder : round.recordings) inputs.emplace_back("Recording", folder);
    return made_by_this_call(std::move(inputs));
  }

  [[nodiscard]] std::uint64_t seed() const { return options_.has_seed ? options_.seed : rig_.sim->seed; }

  void read_first_protocol() {
    pressure_psi_ = options_.pressure_psi;
    if (options_.protocol.empty()) {
      if (pressure_psi_ <= 0.0) {
        pressure_psi_ = rig_.sim->physics ? rig_.sim->physics->nominal_pressure_psi : 15.0;
        pressure_psi_ = std::min(pressure_psi_, 0.8 * rig_.limits.pressure_max_psi);
      }
      first_protocol_ = first_look(rig_, pressure_psi_);
      return;
    }
    first_protocol_ = base::read_config_file(options_.protocol);
    const auto plan =
        protocol::compile(base::TomlDocument::parse_text(first_protocol_, options_.protocol), rig_.limits);
    std::set<double> pressures;
    for (const auto& session : plan.sessions) pressures.insert(session.pressure_psi);
    if (pressure_psi_ <= 0.0 && pressures.size() == 1) pressure_psi_ = *pressures.begin();
    if (!pressures.contains(pressure_psi_)) {
      std::string list;
      for (const double psi : pressures) list += (list.empty() ? "" : ", ") + identify::report::number_text(psi);
      throw base::ConfigError(
          {{options_.protocol, 0, 0,
            "has sessions at " + list + " psi; one model is fitted at one pressure: say which with --pressure"}});
    }
  }

  [[nodiscard]] Round* have(int number) {
    const auto at = static_cast<std::size_t>(number) - 1;
    return at < all_.rounds.size() ? &all_.rounds[at] : nullptr;
  }

  /// What ends the investigation with this round; nullopt when a further one is called for and allowed.
  [[nodiscard]] std::optional<Outcome> ended_by(const Round& round) {
    if (const auto outcome = settled_by(round)) return outcome;
    if (have(round.number + 1) != nullptr) return {};  // it was allowed when it was made, and counts in rig_s() already
    if (round.number >= options_.rounds) return Outcome::kRounds;
    const double next_s = round.experiment.at("duration_s");
    if (all_.rig_s() + next_s > options_.budget_s) return Outcome::kBudget;
    return {};
  }

  /// Runs and exports a round that is not there yet.
  int make(int number) {
    const auto folder = all_.round_folder(number);
    std::filesystem::remove_all(folder);  // of a round that was interrupted
    std::filesystem::create_directories(folder);
    Round round;
    round.number = number;
    const std::string text = number == 1 ? first_protocol_ : all_.rounds.back().experiment_protocol;
    round.text =
        number == 1
            ? (options_.protocol.empty() ? "first look" : std::filesystem::path(options_.protocol).filename().string())
            : all_.rounds.back().experiment.at("text").get<std::string>();
    round.protocol = relative(folder / "protocol.toml");
    base::write_whole_file(folder / "protocol.toml", text);
    daemon::VirtualRunOptions run;
    run.runs_root = folder / "runs";
    run.start.protocol_text = text;
    run.start.protocol_name = (folder / "protocol.toml").string();
    run.seed = seed() + static_cast<std::uint64_t>(number) - 1;  // another day, other noise
    const std::string name = "round " + std::to_string(number);
    std::optional<Progress> progress(std::in_place, name + ", run");
    run.on_progress = [&](const daemon::Status& s, double) { progress->at(double{s.control.progress}); };
    const auto result = daemon::run_virtual(rig_, run);
    progress.reset();
    round.run = result.run_id;
    round.rig_s = result.simulated_s;
    if (result.outcome != "done") {
      std::cerr << "isorig investigate: round " << number << " ended as " << result.outcome
                << (result.fault.empty() ? "" : ": " + result.fault) << "; see " << result.directory.string() << '\n';
      return result.outcome == "failed" ? kTripped : kFailure;
    }
    progress.emplace(name + ", export");
    daemon::ExportOptions how;
    how.run_id = result.run_id;
    how.on_progress = [&](double fraction) { progress->at(fraction); };
    const auto report = daemon::export_run(result.directory, folder / "recordings", how);
    progress.reset();
    for (const auto& line : report.read.complaints()) std::cerr << "isorig investigate: " << line << '\n';
    for (const auto& session : report.sessions)
      if (session.complete && session.pressure_psi == pressure_psi_)
        round.recordings.push_back(relative(session.folder));
    if (round.recordings.empty()) {
      std::cerr << "isorig investigate: round " << number << " has no complete session at " << pressure_psi_
                << " psi\n";
      return kFailure;
    }
    all_.rounds.push_back(std::move(round));
    save(all_);
    return kOk;
  }

  [[nodiscard]] std::string relative(const std::filesystem::path& path) const {
    return std::filesystem::proximate(path, all_.folder).generic_string();
  }

  bool diagnose(Round& round) {
    const auto start = std::chrono::steady_clock::now();
    std::vector<messages::Recording> recordings;
    std::vector<std::string> names;
    for (const Round& each : all_.rounds) {
      for (const std::string& folder : each.recordings) {
        names.push_back(folder);
        recordings.push_back(messages::read_recording(all_.folder / folder));
      }
    }
    identify::DiagnosisOptions settings;
    settings.threads = options_.threads;
    settings.design.rig = rig_.limits;
    settings.design.longest_s = std::clamp(options_.budget_s - all_.rig_s(), 60.0, 1800.0);
    const std::size_t count = recordings.size();
    std::optional<Progress> progress(std::in_place, "round " + std::to_string(round.number) + ", diagnosis");
    settings.on_progress = [&](double fraction, const char* doing) { progress->at(fraction, doing); };
    try {
      const auto study = identify::diagnose(std::move(recordings), std::move(names), nominal_, settings);
      progress.reset();
      take_in(round, study);
      const bool last = ended_by(round).has_value();
      const auto folder = all_.round_folder(round.number) / "diagnosis";
      auto made = provenance();
      made.links.emplace_back("The investigation", "../../investigation-report.html");
      (void)write_diagnosis(study, folder, options_.report && last ? &made : nullptr);  // said; the record goes on
      // The last word lies on top: `isorig predict --model OUT/model.toml`.
      for (const char* file : {"diagnosis.json", "model.toml", "nominal.toml"})
        std::filesystem::copy_file(folder / file, all_.folder / file,
                                   std::filesystem::copy_options::overwrite_existing);
    } catch (const std::invalid_argument& e) {
      progress.reset();
      std::cerr << "isorig investigate: " << e.what() << '\n';
      return false;
    }
    const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::printf("  %zu recording%s diagnosed together in %.1f s\n", count, count == 1 ? "" : "s", took_s);
    save(all_);
    return true;
  }

  static void say(const Round& round) {
    std::printf("  explanations, by probability:\n");
    for (const auto& e : round.explanations) std::printf("  %6.3f  %s\n", e.probability, words_and_name(e.key).c_str());
    for (const std::string& pair : round.inseparable) std::printf("  %s\n", pair.c_str());
    if (round.experiment.is_null()) return;
    const auto& e = round.experiment;
    const bool enough = e.at("reaches_it");
    std::printf("  None stands out. Of %d experiments within the limits, the %s: %s (%s).\n",
                e.at("considered").get<int>(),
                enough ? "shortest that tells them apart" : "one that comes nearest to telling them apart",
                e.at("text").get<std::string>().c_str(), duration_text(e.at("duration_s")).c_str());
    for (const auto& x : e.at("expected"))
      std::printf("    if the truth is %s, %s misses it by %.3g\n",
                  model::explanation_words(x.at("if").get<std::string>()).c_str(),
                  model::explanation_words(x.at("then").get<std::string>()).c_str(), x.at("leaves").get<double>());
    std::printf("    (sum of squares over the noise's; %.0f tell two apart)\n", e.at("enough").get<double>());
    if (!e.at("others").empty()) {
      const auto& again = e.at("others").back();
      std::printf("    for comparison, %s (%s) would miss by %.3g\n", again.at("text").get<std::string>().c_str(),
                  duration_text(again.at("duration_s")).c_str(), again.at("distance").get<double>());
    }
    std::fflush(stdout);
  }

  int finish(Outcome outcome) {
    all_.outcome = outcome;
    all_.text = answer_text(all_);
    save(all_);
    if (options_.report) {
      try {
        write_report(all_, provenance());
      } catch (const std::exception& e) {
        std::cerr << "investigation-report.html: " << e.what() << '\n';
      }
    }
    std::printf("%s\n%zu round%s, %s of rig time. %s/investigation-report.html, investigation.json, model.toml\n",
                all_.text.c_str(), all_.rounds.size(), all_.rounds.size() == 1 ? "" : "s",
                duration_text(all_.rig_s()).c_str(), options_.out.c_str());
    return outcome == Outcome::kRounds || outcome == Outcome::kBudget ? kFailure : kOk;
  }

  const InvestigateOptions& options_;
  daemon::RigConfig rig_;
  model::ModelSpec nominal_;
  std::string first_protocol_;
  double pressure_psi_ = 0.0;
  Investigation all_;
};

Command add_investigate(CLI::App& app) {
  auto o = std::make_shared<InvestigateOptions>();
  auto* sub = app.add_subcommand(
      "investigate",
      "On a simulated rig: run, diagnose, design what separates the tied explanations, run it, until one is left");
  sub->add_option("--rig", o->rig, "The rig's file (config/rigs/)")->required();
  sub->add_option("--protocol", o->protocol, "First protocol; without one, short ramps within the rig's limits");
  sub->add_option("--model", o->model, "Nominal model: slse1, slse2 or a TOML file")->capture_default_str();
  sub->add_option("--pressure", o->pressure_psi,
                  "Which sessions to take, psi, when the protocol has several pressures");
  sub->add_option("--rounds", o->rounds, "At most so many experiments, the first included")
      ->capture_default_str()
      ->check(CLI::Range(1, 50));
  sub->add_option("--budget", o->budget_s, "Seconds of rig time for all of them")
      ->capture_default_str()
      ->check(within(1.0, 1e9));
  sub->add_option("--seed", o->seed, "Of the simulated rig's noise in the first round, instead of the rig file's")
      ->each([o](const std::string&) { o->has_seed = true; });
  sub->add_option("--out", o->out, "Folder for the rounds and the report; an investigation there is gone on with")
      ->required();
  sub->add_option("--threads", o->threads, "Threads to use")->capture_default_str()->check(CLI::Range(1, 64));
  sub->add_flag("!--no-report", o->report, "Leave out investigation-report.html");
  return {sub, [o] { return Loop(*o).run(); }};
}

const Registration kInvestigate(41, add_investigate);

}  // namespace
}  // namespace isorig::cli
