#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "cli/client.hpp"

/// How the rig's state looks to a person: one block for `status`, `watch` and `run`.
namespace isorig::cli {

struct WatchOptions {
  double interval_s = 0.5;
  bool until_done = false;
  bool json = false;  ///< one JSON document a line instead of a screen
};

/// "[#########.........]  47.3 %"
[[nodiscard]] std::string progress_bar(double fraction, int width = 40);
/// The daemon's status (docs/api.md) as a block of text, newline at the end.
[[nodiscard]] std::string status_text(const nlohmann::json& status);
/// Follows the daemon; on a terminal in place, elsewhere line by line. Prints events as they come.
int watch(const Client& client, const WatchOptions& options);

}  // namespace isorig::cli
