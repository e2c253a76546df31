#pragma once
#include <filesystem>
#include <memory>

#include "daemon/config.hpp"

namespace isorig::daemon {

struct DaemonOptions {
  std::filesystem::path runs_root;
  std::filesystem::path socket;
};

/// isorigd: the rig in real time. Owns devices, loop, I/O threads, recorder, publisher and API (docs/threads.md).
class Daemon {
 public:
  /// Opens everything, nothing moves. Throws RealtimeError, base::ConfigError, std::runtime_error.
  Daemon(const RigConfig& rig, const DaemonOptions& options);
  ~Daemon();

  /// Runs until SIGTERM or SIGINT. A run under way is aborted first: the frame stops, the pressure vents.
  void run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::daemon
