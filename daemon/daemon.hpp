#pragma once
#include <filesystem>
#include <memory>

#include "daemon/host/stop_signals.hpp"
#include "daemon/rig/config.hpp"

namespace isorig::daemon {

struct DaemonOptions {
  std::filesystem::path runs_root;
  std::filesystem::path diagnoses_root;  ///< beside those among the runs
  std::filesystem::path socket;
  std::string revision;            ///< of the source, for the recordings
  std::filesystem::path reporter;  ///< isorig, which writes the page of each run; empty: none is written
};

/// isorigd: the rig in real time. Owns devices, loop, I/O threads, recorder, publisher and API (docs/threads.md).
class Daemon {
 public:
  /// Opens everything, nothing moves. Throws RealtimeError, base::ConfigError, std::runtime_error. `signals` were made
  /// before any thread.
  Daemon(const RigConfig& rig, const DaemonOptions& options, const StopSignals& signals);
  ~Daemon();

  /// Runs until a signal. The first aborts a run that is under way, vents, and writes everything, however long the disk
  /// takes; a second one leaves as soon as the frame stands and the pressure is vented, written or not; a third one
  /// leaves at once, and the devices' own watchdogs stop and vent. False when something could not be written.
  [[nodiscard]] bool run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::daemon
