#include "cli/command.hpp"

#include <map>

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

std::vector<AddCommand> commands() {
  std::vector<AddCommand> out;
  for (const auto& [order, add] : registry()) out.push_back(add);
  return out;
}

}  // namespace isorig::cli
