#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

/// What the manual page and the completions are made of: what CLI11 knows of a command.
namespace isorig::cli::reference {

/// "TEXT:{slse1,slse2}" -> "slse1", "slse2"
[[nodiscard]] std::vector<std::string> choices_of(const CLI::Option& option);
[[nodiscard]] bool takes_value(const CLI::Option& option);
/// Without --help, and without what is not meant for people.
[[nodiscard]] std::vector<const CLI::Option*> options_of(const CLI::App& app, bool positionals);
[[nodiscard]] std::vector<const CLI::App*> commands_of(const CLI::App& app);
/// "protocol" -> "PROTOCOL"
[[nodiscard]] std::string positional_name(const CLI::Option& option);
/// "calibrate pressure"; "" for the program.
[[nodiscard]] std::string path_below(const std::string& path, const CLI::App& command);

void print_bash(const CLI::App& app);
void print_zsh(const CLI::App& app);
void print_fish(const CLI::App& app);

}  // namespace isorig::cli::reference
