#pragma once
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/screen/live_verdicts.hpp"

/// How the rig's state looks to a person: one block for `status`, and the body of `watch`.
namespace isorig::cli {

/// "[#########.........]  47.3 %"
[[nodiscard]] std::string progress_bar(double fraction, int width = 40);

/// What the status itself does not know: room, clock, and what has been seen before.
struct StatusContext {
  int bar_width = 40;
  std::string ends;   ///< behind the time left: "ends Mon 03:14"
  std::string force;  ///< behind the force: its sparkline
};
/// The daemon's status (docs/api.md), line by line, printable; the first is rig and state, the most important come
/// first.
[[nodiscard]] std::vector<Said> status_lines(const nlohmann::json& status, const StatusContext& context = {});
/// The same as one block of text, newline at the end.
[[nodiscard]] std::string status_text(const nlohmann::json& status);

}  // namespace isorig::cli
