#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace isorig::base {

struct ProcessResult {
  int exit_code = -1;  ///< 128 and the signal for one that a signal ended
  double wall_s = 0.0;
  double cpu_s = 0.0;  ///< user and system, of the process and its threads
};

/// Runs a program with its output appended to `log`. Throws std::runtime_error when it cannot be started.
[[nodiscard]] ProcessResult run_process(const std::vector<std::string>& command, const std::filesystem::path& log);

}  // namespace isorig::base
