#pragma once
#include <sys/types.h>

#include <filesystem>
#include <mutex>
#include <set>
#include <string>
#include <vector>

namespace isorig::base {

struct ProcessResult {
  int exit_code = -1;  ///< 128 and the signal for one that a signal ended
  int signal = 0;      ///< that signal; 0: it ended by itself
  double wall_s = 0.0;
  double cpu_s = 0.0;    ///< user and system, of the process and its threads
  double peak_MB = 0.0;  ///< the most that was resident of it
};

/// Programs that are under way in several threads, so that another thread can end all of them.
class Processes {
 public:
  /// Sends it to all and their own children; one that begins later gets it as soon as it has begun.
  void end(int signal);
  [[nodiscard]] bool ending() const;  ///< end() was called

 private:
  friend class RunningProcess;
  mutable std::mutex mutex_;
  std::set<pid_t> groups_;
  int ending_ = 0;
};

struct ProcessOptions {
  std::filesystem::path working_directory{};  ///< empty: this process's own
  /// With it the program is a process group of its own, so that Ctrl-C at a terminal reaches this process alone, and it
  /// is killed when this process dies.
  Processes* among = nullptr;
};

/// Runs a program with its output appended to `log`, nothing on its input, and no signal blocked or ignored. Throws
/// std::runtime_error when it cannot be started.
[[nodiscard]] ProcessResult run_process(const std::vector<std::string>& command, const std::filesystem::path& log,
                                        const ProcessOptions& options = {});

}  // namespace isorig::base
