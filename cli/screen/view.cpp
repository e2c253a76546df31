#include "cli/screen/view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iomanip>
#include <sstream>

#include "base/formatted.hpp"
#include "cli/screen/screen.hpp"

namespace isorig::cli {
namespace {

using base::formatted;

constexpr const char* kFooter = " q leaves the view; the run goes on";
constexpr const char* kSilentBar = "\x1b[7m";  ///< of no state: the last one known may be over
constexpr std::array kBars{"\u2581", "\u2582", "\u2583", "\u2584", "\u2585", "\u2586", "\u2587", "\u2588"};
constexpr std::array kPlainBars{"_", ".", ",", "-", "=", "+", "*", "#"};

/// Colours of the terminal's own sixteen, which its owner has chosen to be readable.
const char* colour_of(Tone tone) {
  switch (tone) {
    case Tone::kGood:
      return "\x1b[32m";
    case Tone::kWarn:
      return "\x1b[33m";
    case Tone::kBad:
      return "\x1b[1;31m";
    case Tone::kDim:
      return "\x1b[2m";
    case Tone::kPlain:
      break;
  }
  return "";
}

/// Of the bar that says the state: seen across the room, and never by its colour alone, since the word stands in it.
const char* bar_of(const std::string& state) {
  if (state == "faulted") return "\x1b[1;97;41m";
  if (state == "running") return "\x1b[1;30;42m";
  if (state == "paused" || state == "armed" || state == "countdown" || state == "setup") return "\x1b[1;30;43m";
  if (state == "ready") return "\x1b[1;30;46m";
  return kSilentBar;
}

std::string clock_text(std::time_t at, const char* format) {
  std::tm local{};
  ::localtime_r(&at, &local);
  std::ostringstream text;
  text << std::put_time(&local, format);
  return text.str();
}

bool same_day(std::time_t a, std::time_t b) {
  return clock_text(a, "%F") == clock_text(b, "%F");
}

std::string force_text(const View& v) {
  const int room = v.size.columns - 28;  // what stands before it
  if (room < 10 || v.force_N.size() < 2) return {};
  const auto width = static_cast<std::size_t>(std::min(room - 2, 60));
  std::deque<double> shown = v.force_N;
  while (shown.size() > width) shown.pop_front();
  double low = INFINITY, high = -INFINITY;
  for (const double f : shown) {
    if (!std::isfinite(f)) continue;
    low = std::min(low, f);
    high = std::max(high, f);
  }
  std::string text = sparkline(shown, width, v.utf8);
  const auto range =
      formatted("  %.1f to %.1f N in %.0f s", low, high, static_cast<double>(shown.size()) * v.interval_s);
  if (low <= high && static_cast<std::size_t>(room) > shown.size() + range.size()) text += range;
  return text;
}

}  // namespace

std::string sparkline(const std::deque<double>& values, std::size_t width, bool utf8) {
  const std::size_t count = std::min(width, values.size());
  double low = INFINITY, high = -INFINITY;
  for (std::size_t i = values.size() - count; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) continue;
    low = std::min(low, values[i]);
    high = std::max(high, values[i]);
  }
  std::string out;
  for (std::size_t i = values.size() - count; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      out += ' ';
      continue;
    }
    const double part = high > low ? (values[i] - low) / (high - low) : 0.0;
    const auto bar = static_cast<std::size_t>(std::lround(part * (kBars.size() - 1)));
    out += utf8 ? kBars[bar] : kPlainBars[bar];
  }
  return out;
}

std::string cut(const std::string& text, int columns) {
  if (columns <= 0) return {};
  int seen = 0;
  std::size_t last = 0;  // where the character in the last column begins
  for (std::size_t i = 0; i < text.size(); ++i) {
    if ((static_cast<unsigned char>(text[i]) & 0xC0U) == 0x80U) continue;  // goes on with a character
    if (++seen == columns) last = i;
    if (seen > columns) return text.substr(0, last) + "~";
  }
  return text;
}

std::string ends_text(std::time_t now, double remaining_s, double worst_s) {
  const auto clock = [now](double s) {
    const auto at = now + static_cast<std::time_t>(std::llround(std::max(0.0, s)));
    return clock_text(at, same_day(now, at) ? "%H:%M" : "%a %H:%M");
  };
  std::string text = "ends " + clock(remaining_s);
  if (worst_s > remaining_s + 60.0) text += ", at worst " + clock(worst_s);
  return text;
}

double worst_left_s(const nlohmann::json& plan, const nlohmann::json& status) {
  if (!status.contains("run") || !plan.contains("steps") ||
      plan.value("run", nlohmann::json()) != status["run"]["id"]) {
    return -1.0;
  }
  double sum_s = 0.0;
  const auto& steps = plan["steps"];
  for (std::size_t i = status["run"].value("step", std::size_t{0}); i < steps.size(); ++i) {
    sum_s += steps[i].value("worst_s", 0.0);
  }
  return sum_s;
}

std::vector<std::string> view_lines(const View& v) {
  const int columns = std::max(1, v.size.columns);
  const auto rows = static_cast<std::size_t>(std::max(1, v.size.rows));
  const auto coloured = [&](const char* colour, const std::string& text) {
    return v.colour && *colour != '\0' ? colour + text + "\x1b[0m" : text;
  };
  const bool known = v.status.is_object(), silent = v.silent_s > 0.0 || !known;
  const bool runs = known && v.status.contains("run");
  StatusContext context;
  context.bar_width = std::clamp(columns - 66, 8, 40);
  context.ends = runs ? ends_text(v.now, v.status.value("remaining_s", 0.0), v.worst_s) : "";
  context.force = force_text(v);
  const auto said = known ? status_lines(v.status, context) : std::vector<Said>{{"isorigd", Tone::kPlain}};

  std::vector<std::string> out;
  const auto state = silent ? std::string() : v.status.value("state", "");
  std::string title = " " + said.front().text;
  const auto clock = clock_text(v.now, "%a %H:%M:%S ");
  title = cut(title, columns);
  if (title.size() + clock.size() + 1 < static_cast<std::size_t>(columns)) {
    title += std::string(static_cast<std::size_t>(columns) - title.size() - clock.size(), ' ') + clock;
  }
  out.push_back(coloured(bar_of(state), title));
  if (silent) {
    const auto text = formatted("  no news for %.0f s: isorigd does not answer", v.silent_s);
    out.push_back(
        coloured(colour_of(Tone::kBad), cut(text + (known ? "; what stands here is that old" : ""), columns)));
  }
  for (std::size_t i = 1; i < said.size(); ++i)
    out.push_back(coloured(colour_of(said[i].tone), cut(said[i].text, columns)));
  // The footer keeps its line; of the events the newest that fit, of the status the top.
  const std::size_t room = rows - 1;
  if (out.size() > room) out.resize(room);
  if (room > out.size() + 1 && !v.events.empty()) {
    out.emplace_back();
    const std::size_t fit = std::min(room - out.size(), v.events.size());
    for (std::size_t i = v.events.size() - fit; i < v.events.size(); ++i) {
      out.push_back(coloured(colour_of(v.events[i].tone), cut(" * " + v.events[i].text, columns)));
    }
  }
  while (out.size() < room) out.emplace_back();
  out.push_back(coloured(colour_of(Tone::kDim), cut(runs ? kFooter : " q leaves the view", columns)));
  return out;
}

}  // namespace isorig::cli
