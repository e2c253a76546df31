#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "daemon/host/host.hpp"
#include "daemon/rig/config.hpp"
#include "sim/rig.hpp"

/// `isorig run` on a simulated rig: the daemon's core, services, recorder and catalogue on the virtual rig, one thread,
/// virtual time. Same configuration and seed, same bytes.
namespace isorig::daemon {

struct VirtualRunOptions {
  StartOptions start;
  std::filesystem::path runs_root;
  std::string revision;               ///< of the source, for the recording
  std::optional<std::uint64_t> seed;  ///< instead of the rig's
  std::filesystem::path specimen;     ///< instead of the rig's
  /// Called about ten times a second of wall time.
  std::function<void(const Status&, double wall_s)> on_progress;
  /// Called before the first tick: a test or a study changes the rig (effects, faults).
  std::function<void(sim::Rig&)> prepare;
  /// Called every virtual millisecond, before the core's tick, for tests that compare with the truth.
  std::function<void(sim::Rig&, Core&, std::int64_t now_ns)> on_tick;
  /// Ends the run from outside (Ctrl-C): it is aborted properly, the rig vents.
  std::function<bool()> interrupted;
};

struct VirtualRunResult {
  std::string outcome;  ///< done, aborted, failed, interrupted
  std::string fault;
  std::string run_id;
  std::filesystem::path directory;
  std::uint64_t ticks = 0;
  double simulated_s = 0.0;
  double wall_s = 0.0;
  Status status;
  RecorderStatus recorder;
};

/// Throws base::ConfigError for wrong files, std::runtime_error when the rig does not get ready or the run cannot
/// be opened.
[[nodiscard]] VirtualRunResult run_virtual(const RigConfig& rig, const VirtualRunOptions& options);

}  // namespace isorig::daemon
