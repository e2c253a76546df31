#pragma once
#include <filesystem>

namespace isorig::daemon {

/// Who is called when nobody looks: [notify] of the rig file (docs/config.md).
struct NotifyConfig {
  std::filesystem::path command;  ///< absolute; empty: nobody is called
  double timeout_s = 30.0;        ///< the command and what it has started are ended then
  double interval_s = 10.0;       ///< from the begin of one call to the next; what comes meanwhile waits
  double held_s = 600.0;          ///< paused or faulted with a run open for so long; 0: not told
};

}  // namespace isorig::daemon
