#include <iostream>
#include <memory>
#include <string>

#include "cli/command.hpp"
#include "cli/rig/client.hpp"
#include "cli/rig/daemon_call.hpp"

/// control: who operates the rig; takes control, or gives it back (docs/api.md).
namespace isorig::cli {
namespace {

Command add_control(CLI::App& app) {
  struct ControlOptions : Common {
    bool take = false, take_over = false, give_back = false;
  };
  auto* sub = app.add_subcommand("control", "Who has control of the rig; without an option it is only said");
  auto o = std::make_shared<ControlOptions>();
  auto* take = sub->add_flag("--take", o->take, "Take it, if nobody else has it; the first command does so by itself");
  auto* over = sub->add_flag("--take-over", o->take_over, "Take it from whoever has it, after agreeing with them");
  auto* give = sub->add_flag("--give-back", o->give_back, "Give it back");
  take->excludes(over)->excludes(give);
  over->excludes(give);
  add_common(*sub, *o);
  return {
      sub, [o] {
        return with_daemon([&] {
          const Client client(o->socket);
          const std::string action = o->take ? "take" : o->take_over ? "take-over" : o->give_back ? "give-back" : "";
          if (!action.empty()) return finish(client.post("/v1/control", {{"action", action}}), *o);
          const auto status = client.get("/v1/status");
          if (!status.ok()) return finish(status, *o);
          const auto control = status.body.value("control", nlohmann::json());
          if (o->json) {
            std::cout << control.dump(2) << '\n';
          } else if (control.is_object()) {
            std::cout << base::printable_lines(control.value("text", "")) << " since "
                      << base::printable_lines(control.value("since_utc", "")) << '\n';
          } else {
            std::cout << "nobody has control\n";
          }
          return static_cast<int>(kOk);
        });
      }};
}

const Registration kControl(23, add_control);

}  // namespace
}  // namespace isorig::cli
