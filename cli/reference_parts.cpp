#include "cli/reference_parts.hpp"

#include <algorithm>
#include <cctype>
#include <sstream>

namespace isorig::cli::reference {

std::vector<std::string> choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const auto open = type.find('{'), close = type.rfind('}');
  std::vector<std::string> out;
  if (open == std::string::npos || close < open) return out;
  std::istringstream list(type.substr(open + 1, close - open - 1));
  for (std::string choice; std::getline(list, choice, ',');) out.push_back(choice);
  return out;
}

bool takes_value(const CLI::Option& option) {
  return option.get_items_expected_max() > 0;
}

std::vector<const CLI::Option*> options_of(const CLI::App& app, bool positionals) {
  return app.get_options([positionals](const CLI::Option* o) {
    return o->get_positional() == positionals && !o->check_lname("help") && !o->get_group().empty();
  });
}

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* s) { return !s->get_group().empty(); });
}

std::string positional_name(const CLI::Option& option) {
  std::string name = option.get_name(true);
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::toupper(c); });
  return name;
}

std::string path_below(const std::string& path, const CLI::App& command) {
  return path.empty() ? command.get_name() : path + " " + command.get_name();
}

}  // namespace isorig::cli::reference
