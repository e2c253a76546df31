#pragma once
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "processes.hpp"

namespace isorig::system_test {

/// Processes whose command line holds this text, its words set apart by spaces.
inline std::vector<pid_t> processes_with(const std::string& text) {
  std::vector<pid_t> out;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::string line = slurp(entry.path() / "cmdline");
    std::ranges::replace(line, '\0', ' ');
    if (line.find(text) != std::string::npos) out.push_back(std::stoi(name));
  }
  return out;
}

}  // namespace isorig::system_test
