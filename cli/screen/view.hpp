#pragma once
#include <ctime>
#include <deque>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/screen/live_verdicts.hpp"
#include "cli/screen/terminal.hpp"

/// What `isorig watch` draws. Pure: the status, what was seen before, a clock and a size in; lines out.
namespace isorig::cli {

/// The newest `width` values as bars of eight heights, the lowest value the lowest bar; a NaN is a gap. "" for none.
[[nodiscard]] std::string sparkline(const std::deque<double>& values, std::size_t width, bool utf8);

/// The beginning of UTF-8 `text` that fits `columns`, each character counted as one; cut text ends in "~".
[[nodiscard]] std::string cut(const std::string& text, int columns);

/// "ends Mon 03:14", with the day only where it is not today; local time. `worst_s` (negative: not known) adds "at
/// worst".
[[nodiscard]] std::string ends_text(std::time_t now, double remaining_s, double worst_s);

/// Time that the plan (GET /v1/plan) can still take from the step of the status on; -1 where it cannot be said.
[[nodiscard]] double worst_left_s(const nlohmann::json& plan, const nlohmann::json& status);

struct View {
  nlohmann::json status;  ///< null: none came yet
  double silent_s = 0.0;  ///< for how long isorigd has not answered: the status is that old
  double worst_s = -1.0;
  std::deque<double> force_N;  ///< newest last, one for each look
  double interval_s = 0.5;
  std::deque<Said> events;  ///< newest last
  std::time_t now = 0;
  TerminalSize size;
  bool colour = true, utf8 = true;
};
/// Never more than `size.rows` lines, none wider than `size.columns`; the last one says how to leave.
[[nodiscard]] std::vector<std::string> view_lines(const View& view);

}  // namespace isorig::cli
