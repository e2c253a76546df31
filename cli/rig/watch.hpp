#pragma once
#include <string>

#include "cli/rig/client.hpp"

namespace isorig::cli {

struct WatchOptions {
  double interval_s = 0.5;
  bool until_done = false;
  bool json = false;  ///< one JSON document a line instead of a screen
  std::string run;    ///< with until_done: this one, although it may be over already; else the run that is, or the next
};

/// Follows the daemon; on a terminal on its alternate screen, elsewhere line by line. Leaving it ends nothing.
int watch(const Client& client, const WatchOptions& options);

}  // namespace isorig::cli
