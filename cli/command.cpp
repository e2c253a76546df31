#include "cli/command.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>

#include "base/nearest.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
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
  const auto& commands = registry();
  if (std::adjacent_find(commands.begin(), commands.end(),
                         [](const auto& a, const auto& b) { return a.first == b.first; }) != commands.end())
    throw std::logic_error("two commands have the same number; give the new one another (cli/command.hpp)");
  for (const auto& [order, add] : commands) all.push_back(add(app));
  return all;
}

namespace {

/// Commands and options are short; a word of another length was not meant to be one.
constexpr std::size_t kLongestWord = 64;

/// `known` without the dashes of options, which every option has: with them --rigg would be near to --go.
std::string guess(std::string_view word, const std::vector<std::string>& known, const std::string& dashes = "") {
  if (word.starts_with(dashes)) word.remove_prefix(dashes.size());
  const auto meant = word.size() > kLongestWord ? std::string() : base::nearest(word, known);
  return meant.empty() ? ";" : "; did you mean `" + dashes + meant + "`?";
}

std::string no_such_command(const CLI::App& app, const std::string& word) {
  std::vector<std::string> known;
  for (const auto* sub : app.get_subcommands(nullptr)) known.push_back(sub->get_name());
  if (std::find(known.begin(), known.end(), word) != known.end()) return {};
  return "there is no command `" + base::printable(word) + "`" + guess(word, known) + " `isorig --help` lists all";
}

std::string no_such_option(const CLI::App& sub, std::string word) {
  word.resize(std::min(word.find('='), word.size()));
  std::vector<std::string> known;
  for (const auto* option : sub.get_options(nullptr)) {
    for (const auto& name : option->get_lnames()) known.push_back(name);
  }
  if (word.starts_with("--") && std::find(known.begin(), known.end(), word.substr(2)) != known.end()) return {};
  const std::string name = sub.get_parent() == nullptr ? "" : sub.get_name();
  return (name.empty() ? "" : name + ": ") + "there is no option `" + base::printable(word) + "`" +
         guess(word, known, "--") + " `isorig " + (name.empty() ? "" : name + " ") + "--help` lists all";
}

}  // namespace

namespace {

std::string& remembered() {
  static std::string line;
  return line;
}

}  // namespace

void remember_command_line(int argc, const char* const* argv) {
  remembered() = "isorig";
  for (int i = 1; i < argc; ++i) {
    const std::string word = base::printable(argv[i]);
    const bool plain = !word.empty() && word.find_first_of(" \t\"'`$&|;<>()*?[]{}\\!#~") == std::string::npos;
    remembered() += plain ? " " + word : " '" + word + "'";
  }
}

const std::string& command_line() {
  return remembered();
}

std::string unknown_word(const CLI::App& app, int argc, const char* const* argv, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return {};  // --help, --version
  if (argc == 1) return "name a command: `isorig --help` lists all, `isorig COMMAND --help` explains one";
  if (app.get_subcommands().empty()) {
    const std::string_view word = argv[1];
    if (!word.starts_with('-')) return no_such_command(app, argv[1]);
    return word.starts_with("--") ? no_such_option(app, argv[1]) : std::string();
  }
  if (dynamic_cast<const CLI::ExtrasError*>(&error) == nullptr) return {};
  const auto& sub = *app.get_subcommands().front();
  for (const auto& word : sub.remaining()) {
    if (word.starts_with("--")) return no_such_option(sub, word);
  }
  return {};
}

CLI::Validator within(double low, double high) {
  const auto range = "[" + base::number_text(low) + " - " + base::number_text(high) + "]";
  return {[low, high, range](const std::string& text) {
            double value = 0.0;
            const bool is_number = CLI::detail::lexical_cast(text, value);
            return is_number && value >= low && value <= high ? std::string()
                                                              : "Value " + text + " not in range " + range;
          },
          "FLOAT in " + range};
}

std::string why_not_the_command(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0 || app.get_subcommands().empty()) return {};
  const std::string name = app.get_subcommands().front()->get_name();
  return name + ": " + error.what() + "; `isorig " + name + " --help` says what it takes";
}

}  // namespace isorig::cli
