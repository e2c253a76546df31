#include <exception>
#include <filesystem>
#include <iostream>

#include "base/toml_reader.hpp"
#include "cli/command.hpp"

int main(int argc, char** argv) {
  using namespace isorig;
  CLI::App app("Iso-velocity tests on pneumatic actuators: what a person or a script does with the rig",
               "isorig");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 bad input, 4 no daemon, 5 refused, 6 tripped, 7 data lost.");
  std::vector<cli::Command> commands;
  for (const auto add : cli::commands()) commands.push_back(add(app));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? cli::kOk : cli::kUsage;
  }
  try {
    for (const auto& command : commands) {
      if (command.app->parsed()) return command.run();
    }
  } catch (const base::ConfigError& e) {
    std::cerr << e.what() << '\n';
    return cli::kBadInput;
  } catch (const std::filesystem::filesystem_error& e) {
    std::cerr << "isorig: cannot use " << e.path1().string() << ": " << e.code().message()
              << "; name another place, or check that it is a directory that you may write\n";
    return cli::kFailure;
  } catch (const std::exception& e) {
    std::cerr << "isorig: " << e.what() << '\n';
    return cli::kFailure;
  }
  return cli::kUsage;
}
