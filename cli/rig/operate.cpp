#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <memory>
#include <string>

#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/rig/acts.hpp"
#include "cli/rig/client.hpp"
#include "cli/rig/daemon_call.hpp"
#include "cli/rig/watch.hpp"
#include "cli/screen/screen.hpp"
#include "daemon/host/paths.hpp"

/// start, pause, resume, abort, reset, status: the operator's verbs, each one call to the daemon.
namespace isorig::cli {
namespace {

bool asked(const char* question) {
  std::cout << question << std::flush;
  std::string answer;
  std::getline(std::cin, answer);
  return answer == "y" || answer == "Y" || answer == "yes";
}

int not_started() {
  std::cerr << "not started\n";
  return kRefused;
}

/// Shows what would be started, and asks. A program or a script is not asked.
bool confirmed(const Client& client, nlohmann::json body, bool yes) {
  if (yes || ::isatty(STDIN_FILENO) == 0 || ::isatty(STDOUT_FILENO) == 0) return true;
  body["dry_run"] = true;
  const auto seen = client.post("/v1/start", body);
  if (!seen.ok()) return true;  // refused just the same by the start itself, which says why
  const auto& s = seen.body;
  const auto who = s.value("operator", "");
  std::printf("rig       %s%s\n", s.value("rig", "").c_str(), s.value("simulated", false) ? " (simulated)" : "");
  std::printf(
      "specimen  %s, %.6g mm at rest%s\n", s.value("specimen", "").c_str(), s.value("rest_length_mm", 0.0),
      s.value("specimen_is_the_rigs", false) ? "; as the rig's file has it: is this the one that is mounted?" : "");
  std::printf("operator  %s\n", who.empty() ? "not named (--operator)" : who.c_str());
  std::printf("protocol  %s: %d sessions, %s expected, %s at worst\n", s.value("protocol", "").c_str(),
              s.value("sessions", 0), duration_text(s.value("nominal_s", 0.0)).c_str(),
              duration_text(s.value("worst_s", 0.0)).c_str());
  std::printf("          up to %.6g psi, between %+.6g and %+.6g mm of the rest length\n",
              s.value("pressure_max_psi", 0.0), s.value("position_min_mm", 0.0), s.value("position_max_mm", 0.0));
  if (const auto run = s.value("run", ""); !run.empty()) std::printf("run       %s goes on\n", run.c_str());
  if (const auto changed = s.value("changed", ""); !changed.empty()) std::printf("CHANGED   %s\n", changed.c_str());
  if (const auto warnings = s.value("warnings", ""); !warnings.empty()) std::printf("%s\n", warnings.c_str() + 1);
  return asked("start? [y/N] ");
}

Command add_start(CLI::App& app) {
  struct StartOptions : Common {
    std::string protocol, specimen, operator_name;
    bool watch = false, until_done = false, yes = false, go = false;
  };
  auto* sub = app.add_subcommand("start", "Start a protocol on the daemon's rig");
  auto o = std::make_shared<StartOptions>();
  sub->add_option("protocol", o->protocol, "Protocol file (TOML)")->required();
  sub->add_option("--specimen", o->specimen, "Specimen file, if not the rig's own");
  sub->add_option("--operator", o->operator_name, "Who runs it; kept in the catalogue");
  sub->add_flag("--yes,-y", o->yes, "Start without showing what and asking; a script is not asked");
  sub->add_flag("--watch", o->watch, "Follow it afterwards, as `isorig watch` does");
  sub->add_flag("--until-done", o->until_done, "Follow this run and return when it has ended, with its exit code");
  sub->add_flag("--go", o->go, "On a rig that has to be armed: ask here whether everybody is clear, then go");
  add_common(*sub, *o);
  return {
      sub, [o] {
        return with_daemon([&] {
          nlohmann::json body{{"protocol", base::read_config_file(o->protocol)},
                              {"protocol_name", o->protocol},
                              {"operator", o->operator_name}};
          if (!o->specimen.empty()) {
            body["specimen"] = base::read_config_file(o->specimen);
            body["specimen_name"] = o->specimen;
          }
          const Client client(o->socket);
          if (!confirmed(client, body, o->yes || o->json)) return not_started();
          if (o->go && !someone_is_there() && client.get("/v1/status").body.value("arming", "") == "required") {
            std::cerr
                << "isorig start: --go needs a person at a terminal on this rig ([operator] arming = \"required\"); "
                << "isorig start, then isorig go\n";
            return static_cast<int>(kRefused);
          }
          auto started = client.post("/v1/start", body);
          int code = finish(started, *o);
          if (code == kOk && o->go) {
            if (const auto answer = second_act(client)) {
              code = finish(*answer, *o);
              started = *answer;
            }
          }
          if (code != kOk || !(o->watch || o->until_done)) return code;
          // A rig that has to be armed opens its run, and names it, with the second act.
          return watch(client, {.until_done = o->until_done, .json = o->json, .run = started.body.value("run", "")});
        });
      }};
}

Command add_resume(CLI::App& app) {
  struct ResumeOptions : Common {
    std::string run, specimen, operator_name;
    bool aborted = false, on_another_rig = false, another_specimen = false, yes = false;
  };
  auto* sub = app.add_subcommand(
      "resume", "Go on: a paused run, or with RUN one that was interrupted, from its interrupted repetition");
  auto o = std::make_shared<ResumeOptions>();
  sub->add_option("run", o->run, "An interrupted run (isorig runs)");
  sub->add_option("--specimen", o->specimen, "File of the specimen that is mounted, if not the rig's own");
  sub->add_option("--operator", o->operator_name, "Who goes on with it");
  sub->add_flag("--aborted", o->aborted, "Go on although an operator had ended it");
  sub->add_flag("--on-another-rig", o->on_another_rig,
                "Go on although it was recorded on another rig; noted in the run");
  sub->add_flag("--another-specimen", o->another_specimen,
                "Go on although another specimen is mounted; noted in the run");
  sub->add_flag("--yes,-y", o->yes, "Go on without showing with what and asking; a script is not asked");
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              const Client client(o->socket);
              if (o->run.empty()) return finish(client.post("/v1/resume"), *o);
              nlohmann::json body{{"resume_run", o->run},
                                  {"operator", o->operator_name},
                                  {"resume_aborted", o->aborted},
                                  {"on_another_rig", o->on_another_rig},
                                  {"another_specimen", o->another_specimen}};
              if (!o->specimen.empty()) {
                body["specimen"] = base::read_config_file(o->specimen);
                body["specimen_name"] = o->specimen;
              }
              if (!confirmed(client, body, o->yes || o->json)) return not_started();
              return finish(client.post("/v1/start", body), *o);
            });
          }};
}

/// Who wants the rig to stop must not wait for a daemon that hangs: it answers within milliseconds, or not at all.
constexpr std::chrono::seconds kStopPatience{5};

Command add_stop(CLI::App& app, const char* name, const char* help) {
  auto* sub = app.add_subcommand(name, help);
  auto o = std::make_shared<Common>();
  add_common(*sub, *o);
  return {sub, [o, name = std::string(name)] {
            return with_daemon([&] {
              try {
                return finish(Client(o->socket, kStopPatience).post("/v1/" + name), *o);
              } catch (const NoAnswer& e) {
                throw NoAnswer(std::string(e.what()) + " within " + std::to_string(kStopPatience.count()) +
                               " s: it hangs or is stopped, and nobody knows whether it has taken the " + name +
                               ". Without its heartbeat the devices stop and vent by themselves; look at the rig, and "
                               "press the emergency stop if they do not");
              }
            });
          }};
}

Command add_verb(CLI::App& app, const char* name, const char* help) {
  auto* sub = app.add_subcommand(name, help);
  auto o = std::make_shared<Common>();
  add_common(*sub, *o);
  return {sub, [o, path = std::string("/v1/") + name] {
            return with_daemon([&] { return finish(Client(o->socket).post(path), *o); });
          }};
}

Command add_pause(CLI::App& app) {
  return add_stop(app, "pause", "The frame stops and holds, the pressure is held, the plan waits");
}
Command add_abort(CLI::App& app) {
  return add_stop(app, "abort", "End the run: the frame stops, the pressure vents");
}
Command add_seal(CLI::App& app) {
  return add_verb(app, "seal", "Of a paused run: both valves shut, to see whether it leaks; resume takes it up again");
}
Command add_reset(CLI::App& app) {
  return add_verb(app, "reset", "Clear a fault whose cause is gone; then resume, abort or start");
}

Command add_confirm_zero(CLI::App& app) {
  return add_verb(app, "confirm-zero", "The frame was started: you have looked at its zero, and positions are right");
}

Command add_status(CLI::App& app) {
  auto* sub = app.add_subcommand("status", "What the rig is doing, once");
  auto o = std::make_shared<Common>();
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              const auto answer = Client(o->socket, kStopPatience).get("/v1/status");
              if (o->json || !answer.ok()) return finish(answer, *o);
              std::cout << base::printable_lines(status_text(answer.body));
              return static_cast<int>(kOk);
            });
          }};
}

Command add_watch(CLI::App& app) {
  struct WatchCommandOptions : Common {
    double interval_s = 0.5;
    bool until_done = false;
    std::string run;
  };
  auto* sub = app.add_subcommand("watch", "Follow a run live: step, progress, time left, force, position, pressure");
  auto o = std::make_shared<WatchCommandOptions>();
  sub->add_option("--interval-s", o->interval_s, "Between two looks")->check(within(0.05, 3600.0));
  auto* until =
      sub->add_flag("--until-done", o->until_done,
                    "Return when the run has ended, with its exit code; waits for the next one if none is open");
  sub->add_option("--run", o->run, "With --until-done: this run, although it may be over already and others came since")
      ->needs(until);
  add_common(*sub, *o);
  return {
      sub, [o] {
        return with_daemon([&] { return watch(Client(o->socket), {o->interval_s, o->until_done, o->json, o->run}); });
      }};
}

const Registration kStart(11, add_start);
const Registration kWatch(13, add_watch);
const Registration kStatus(14, add_status);
const Registration kPause(15, add_pause);
const Registration kResume(16, add_resume);
const Registration kAbort(17, add_abort);
const Registration kReset(18, add_reset);
const Registration kSeal(27, add_seal);
const Registration kConfirmZero(22, add_confirm_zero);

}  // namespace
}  // namespace isorig::cli
