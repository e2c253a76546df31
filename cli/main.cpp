#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "cli/command.hpp"
#include "messages/run_log.hpp"

namespace {

/// What was printed is all on its way, or it is said: a full disk behind a redirection must not look like a result.
int written(int code) {
  using namespace isorig;
  errno = 0;
  std::cout.flush();
  const bool flushed = std::fflush(stdout) == 0;
  if (std::cout.good() && flushed && std::ferror(stdout) == 0) return code;
  // Where an earlier write has failed, its reason is gone.
  std::cerr << "isorig: not everything could be printed"
            << (errno != 0 ? std::string(": ") + std::strerror(errno) : "; is the disk full, or the output closed?")
            << '\n';
  return code == cli::kOk ? static_cast<int>(cli::kFailure) : code;
}

}  // namespace

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
    return written(app.exit(e) == 0 ? cli::kOk : cli::kUsage);
  }
  try {
    for (const auto& command : commands) {
      if (command.app->parsed()) return written(command.run());
    }
  } catch (const CLI::ParseError& e) {  // what only the command itself could judge
    std::cerr << "isorig: " << base::printable_lines(e.what()) << '\n';
    return cli::kUsage;
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
