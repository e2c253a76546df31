#include "cli/rig/acts.hpp"

#include <unistd.h>

#include <memory>
#include <optional>
#include <string>

#include "cli/rig/daemon_call.hpp"
#include "cli/rig/rig_at_rest.hpp"

/// go, setup, jog, accept-rig: what an operator does before and beside a run.
namespace isorig::cli {

bool someone_is_there() {
  return ::isatty(STDIN_FILENO) != 0;
}

std::optional<Answer> second_act(const Client& client) {
  const auto status = client.get("/v1/status");
  if (status.body.value("state", "") != "armed") return std::nullopt;
  if (someone_is_there()) {
    const auto line = ask("Is everybody clear of the rig? Type go and press Enter: ");
    if (line && *line == "go") return client.post("/v1/go");
  }
  const auto paused = client.post("/v1/pause");
  const auto state = client.get("/v1/status").body.value("state", "");
  std::string text = someone_is_there() ? "not confirmed"
                                        : "this rig has to be armed, and nobody is at a terminal to say that everybody "
                                          "is clear: isorig start, then isorig go";
  const bool is_armed = state != "ready" && state != "idle" && state != "paused";
  if (is_armed) {
    text += "; the rig was not seen to be taken back, it is " + state + ": " + paused.text();
  } else if (someone_is_there()) {
    text += ": the rig is not armed any more";
  }
  return Answer{409, {{"text", text}}};
}

namespace {

Command add_go(CLI::App& app) {
  auto* sub =
      app.add_subcommand("go", "The second act of a start: the countdown begins, then the rig moves; keep clear");
  auto o = std::make_shared<Common>();
  add_common(*sub, *o);
  return {sub, [o] { return with_daemon([&] { return finish(Client(o->socket).post("/v1/go"), *o); }); }};
}

Command add_setup(CLI::App& app) {
  struct SetupOptions : Common {
    bool off = false;
  };
  auto* sub =
      app.add_subcommand("setup", "Between runs, vented: allow the crosshead to be jogged, at reduced speed and force");
  auto o = std::make_shared<SetupOptions>();
  sub->add_flag("--off", o->off, "Leave it");
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] { return finish(Client(o->socket).post("/v1/setup", {{"off", o->off}}), *o); });
          }};
}

Command add_jog(CLI::App& app) {
  struct JogOptions : Common {
    double to_mm = 0.0, by_mm = 0.0, velocity_mm_s = 0.0;
  };
  auto* sub =
      app.add_subcommand("jog", "In setup: move the crosshead; beyond a limit only back. isorig pause stops it");
  auto o = std::make_shared<JogOptions>();
  auto* to = sub->add_option("--to", o->to_mm, "Position, mm");
  auto* by = sub->add_option("--by", o->by_mm, "From where it is, mm");
  auto* velocity = sub->add_option("--velocity", o->velocity_mm_s, "mm/s; else as fast as a jog may be");
  to->excludes(by);
  velocity->check(within(1e-6, 500.0));
  add_common(*sub, *o);
  return {sub, [o, to, by, velocity] {
            if (to->count() + by->count() != 1) {
              std::cerr << "isorig jog: one of --to and --by says where to\n";
              return static_cast<int>(kUsage);
            }
            nlohmann::json body;
            if (to->count() > 0) body["to_mm"] = o->to_mm;
            if (by->count() > 0) body["by_mm"] = o->by_mm;
            if (velocity->count() > 0) body["velocity_mm_s"] = o->velocity_mm_s;
            return with_daemon([&] { return finish(Client(o->socket).post("/v1/jog", body), *o); });
          }};
}

Command add_accept_rig(CLI::App& app) {
  struct AcceptRigOptions : Common {
    std::string operator_name;
  };
  auto* sub = app.add_subcommand(
      "accept-rig",
      "Sign off the rig file as the daemon has read it, after looking at what has changed (isorig status)");
  auto o = std::make_shared<AcceptRigOptions>();
  sub->add_option("--operator", o->operator_name, "Who accepts it; kept with the time and the user")->required();
  add_common(*sub, *o);
  return {sub, [o] {
            return with_daemon([&] {
              return finish(Client(o->socket).post("/v1/accept-rig", {{"operator", o->operator_name}}), *o);
            });
          }};
}

const Registration kGo(12, add_go);
const Registration kSetup(19, add_setup);
const Registration kJog(20, add_jog);
const Registration kAcceptRig(26, add_accept_rig);

}  // namespace
}  // namespace isorig::cli
