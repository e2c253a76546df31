#include <exception>
#include <filesystem>
#include <iostream>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "cli/command.hpp"
#include "messages/run_log.hpp"

int main(int argc, char** argv) {
  using namespace isorig;
  if (const auto why = base::why_not_arguments(argc, argv); !why.empty()) {
    std::cerr << "isorig: " << why << '\n';
    return cli::kUsage;
  }
  cli::remember_command_line(argc, argv);
  CLI::App app;
  const auto commands = cli::build(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (const auto unknown = cli::unknown_word(app, argc, argv, e); !unknown.empty()) {
      std::cerr << "isorig: " << unknown << '\n';
      return cli::kUsage;
    }
    if (const auto why = cli::why_not_the_command(app, e); !why.empty()) {
      std::cerr << "isorig: " << base::printable_lines(why) << '\n';
      return cli::kUsage;
    }
    return app.exit(e) == 0 ? cli::kOk : cli::kUsage;
  }
  try {
    for (const auto& command : commands) {
      if (command.app->parsed()) return command.run();
    }
  } catch (const base::ConfigError& e) {
    std::cerr << e.what() << '\n';
    return cli::kBadInput;
  } catch (const messages::UnknownLogVersion& e) {
    std::cerr << "isorig: " << base::printable_lines(e.what()) << '\n';
    return cli::kBadInput;
  } catch (const std::filesystem::filesystem_error& e) {
    std::cerr << "isorig: cannot use " << base::printable(e.path1().string()) << ": " << e.code().message()
              << "; name another place, or check that it is a directory that you may write\n";
    return cli::kFailure;
  } catch (const std::exception& e) {
    std::cerr << "isorig: " << base::printable_lines(e.what()) << '\n';
    return cli::kFailure;
  }
  return cli::kUsage;
}
