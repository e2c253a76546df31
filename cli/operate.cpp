#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>

#include "base/toml_reader.hpp"
#include "cli/client.hpp"
#include "cli/command.hpp"
#include "cli/screen.hpp"
#include "daemon/paths.hpp"

/// start, pause, resume, abort, reset, status: the operator's verbs, each one call to the daemon.
namespace isorig::cli {
namespace {

struct Common {
  std::string socket = daemon::default_socket().string();
  bool json = false;
};

void add_common(CLI::App& sub, Common& common) {
  sub.add_option("--socket", common.socket, "The daemon's socket")->capture_default_str();
  sub.add_flag("--json", common.json, "Print the daemon's answer as it came");
}

std::string read_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw base::ConfigError({{path, 0, 0, "cannot be opened; check the path and its permissions"}});
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

int finish(const Answer& answer, const Common& common) {
  if (common.json) {
    std::cout << answer.body.dump(2) << '\n';
  } else if (answer.ok()) {
    std::cout << answer.text() << '\n';
  } else {
    std::cerr << answer.text() << '\n';
  }
  if (answer.ok()) return kOk;
  return answer.status == 400 ? kBadInput : kRefused;
}

template <typename Call>
int with_daemon(Call&& call) {
  try {
    return call();
  } catch (const NoDaemon& e) {
    std::cerr << "isorig: " << e.what() << '\n';
    return kNoDaemon;
  }
}

Command add_start(CLI::App& app) {
  struct Options : Common {
    std::string protocol, specimen, operator_name;
    bool watch = false;
  };
  auto* sub = app.add_subcommand("start", "Start a protocol on the daemon's rig");
  auto o = std::make_shared<Options>();
  sub->add_option("protocol", o->protocol, "Protocol file (TOML)")->required();
  sub->add_option("--specimen", o->specimen, "Specimen file, if not the rig's own");
  sub->add_option("--operator", o->operator_name, "Who runs it; kept in the catalogue");
  sub->add_flag("--watch", o->watch, "Follow it afterwards, as `isorig watch` does");
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              nlohmann::json body{{"protocol", read_text(o->protocol)},
                                  {"protocol_name", o->protocol},
                                  {"operator", o->operator_name}};
              if (!o->specimen.empty()) {
                body["specimen"] = read_text(o->specimen);
                body["specimen_name"] = o->specimen;
              }
              const int code = finish(Client(o->socket).post("/v1/start", body), *o);
              return code == kOk && o->watch ? watch(Client(o->socket), {}) : code;
            });
          }};
}

Command add_resume(CLI::App& app) {
  struct Options : Common {
    std::string run;
  };
  auto* sub = app.add_subcommand(
      "resume", "Go on: a paused run, or with RUN one that was interrupted, from its interrupted repetition");
  auto o = std::make_shared<Options>();
  sub->add_option("run", o->run, "An interrupted run (isorig runs)");
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              const Client client(o->socket);
              return finish(o->run.empty() ? client.post("/v1/resume")
                                           : client.post("/v1/start", {{"protocol", ""}, {"resume_run", o->run}}),
                            *o);
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
  return add_verb(app, "pause", "The frame stops and holds, the pressure is held, the plan waits");
}
Command add_abort(CLI::App& app) {
  return add_verb(app, "abort", "End the run: the frame stops, the pressure vents");
}
Command add_reset(CLI::App& app) {
  return add_verb(app, "reset", "Clear a fault whose cause is gone; then resume, abort or start");
}

Command add_status(CLI::App& app) {
  auto* sub = app.add_subcommand("status", "What the rig is doing, once");
  auto o = std::make_shared<Common>();
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              const auto answer = Client(o->socket).get("/v1/status");
              if (o->json || !answer.ok()) return finish(answer, *o);
              std::cout << status_text(answer.body);
              return static_cast<int>(kOk);
            });
          }};
}

Command add_watch(CLI::App& app) {
  struct Options : Common {
    double interval_s = 0.5;
    bool until_done = false;
  };
  auto* sub = app.add_subcommand("watch", "Follow a run live: step, progress, time left, force, position, pressure");
  auto o = std::make_shared<Options>();
  sub->add_option("--interval-s", o->interval_s, "Between two looks")->check(CLI::Range(0.05, 3600.0));
  sub->add_flag("--until-done", o->until_done, "Return when the run has ended, with its exit code");
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] { return watch(Client(o->socket), {o->interval_s, o->until_done, o->json}); });
          }};
}

const Registration kStart(20, add_start);
const Registration kWatch(21, add_watch);
const Registration kStatus(22, add_status);
const Registration kPause(23, add_pause);
const Registration kResume(24, add_resume);
const Registration kAbort(25, add_abort);
const Registration kReset(26, add_reset);

}  // namespace
}  // namespace isorig::cli
