#include "cli/command.hpp"

#include <map>

#include "daemon/version.hpp"

namespace isorig::cli {
namespace {

std::multimap<int, AddCommand>& registry() {
  static std::multimap<int, AddCommand> all;  // on first use: registrations run before main, in any order
  return all;
}

}  // namespace

Registration::Registration(int order, AddCommand add) {
  registry().emplace(order, add);
}

std::vector<Command> build(CLI::App& app) {
  app.name("isorig");
  app.description("Iso-velocity tests on pneumatic actuators: what a person or a script does with the rig");
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("isorig ") + daemon::kVersion);
  app.footer("Exit codes: 0 ok, 1 failure, 2 usage, 3 bad input, 4 no daemon, 5 refused, 6 tripped, 7 data lost.");
  std::vector<Command> all;
  for (const auto& [order, add] : registry()) all.push_back(add(app));
  return all;
}

}  // namespace isorig::cli
