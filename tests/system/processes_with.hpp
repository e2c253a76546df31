#pragma once
#include <algorithm>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "processes.hpp"

namespace isorig::system_test {

/// Processes whose command line holds this text, its words set apart by spaces. A child of such a process with the same
/// command line is not another of them: it is a shell on its way to the next command, between fork and exec.
inline std::vector<pid_t> processes_with(const std::string& text) {
  std::map<pid_t, std::string> lines;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::string line = slurp(entry.path() / "cmdline");
    std::ranges::replace(line, '\0', ' ');
    if (line.find(text) != std::string::npos) lines.emplace(std::stoi(name), std::move(line));
  }
  std::vector<pid_t> out;
  for (const auto& [pid, line] : lines) {
    const std::string status = slurp("/proc/" + std::to_string(pid) + "/status");
    const auto field = status.find("\nPPid:");
    if (field == std::string::npos) continue;  // it ended meanwhile
    const auto parent = lines.find(std::stoi(status.substr(field + 6)));
    if (parent == lines.end() || parent->second != line) out.push_back(pid);
  }
  return out;
}

}  // namespace isorig::system_test
