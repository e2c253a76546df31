#pragma once
#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

#include "cli/screen/exit_codes.hpp"

/// One file per subcommand, each with a Registration at its end; main() knows none of them by name:
///
///   Command add_check(CLI::App& app) {
///     auto* sub = app.add_subcommand("check", "...");
///     auto options = std::make_shared<Options>();
///     sub->add_option(...);
///     return {sub, [options] { return run(*options); }};
///   }
///   const Registration kCheck(1, add_check);
namespace isorig::cli {

/// A number from `low` to `high`. CLI::Range takes "nan" for one of its range.
[[nodiscard]] CLI::Validator within(double low, double high);

struct Command {
  CLI::App* app = nullptr;
  std::function<int()> run;  ///< returns an ExitCode; may throw base::ConfigError (kBadInput) or std::exception
};

using AddCommand = Command (*)(CLI::App&);

/// Adds a subcommand to the list at start-up; `order` sorts the help: from 1 protocols, from 10 runs on the rig, from
/// 30 recordings and diagnosis. Each has a number of its own: which file registers first differs from build to build.
struct Registration {
  Registration(int order, AddCommand add);
};

/// The whole program: name, description, version and every command that registered, in order.
[[nodiscard]] std::vector<Command> build(CLI::App& app);

/// What a command misses or cannot take, with its name; empty before a command was named, and of --help.
[[nodiscard]] std::string why_not_the_command(const CLI::App& app, const CLI::ParseError& error);

/// What a word on the command line that is no command, or no option of its command, was most likely meant to be; empty
/// when `error` is about something else.
[[nodiscard]] std::string unknown_word(const CLI::App& app, int argc, const char* const* argv,
                                       const CLI::ParseError& error);

/// How this program was called, for the foot of the reports it writes: main() sets it, quoted so that a shell takes it.
void remember_command_line(int argc, const char* const* argv);
[[nodiscard]] const std::string& command_line();

}  // namespace isorig::cli
