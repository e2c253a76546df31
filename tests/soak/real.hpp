#pragma once
#include <filesystem>
#include <string>

namespace isorig::soak {

struct RealOptions {
  double seconds = 0.0;
  std::string rig;
  std::filesystem::path out;       ///< folder: runs, rig's log
  std::filesystem::path programs;  ///< where isorigd and isorig are
  bool real_time = true;           ///< else isorigd --no-realtime
  bool load = true;                ///< every processor busy, the disk written to
};

/// isorigd as a process on the simulated rig, at 1 kHz, with processors and disk busy. What it measured, on the
/// standard output; 0 when no sample was lost and neither memory nor descriptors grew.
int soak_in_real_time(const RealOptions& options);

}  // namespace isorig::soak
