#include "daemon/journal.hpp"

#include <spdlog/spdlog.h>

#include <string_view>

namespace isorig::daemon {

void log_event(const EventRecord& e) {
  const std::string_view code = e.code;
  if (code == "step" || code == "mark") return;
  const auto level = e.severity >= Severity::kProgramStop ? spdlog::level::err
                     : e.severity == Severity::kWarning   ? spdlog::level::warn
                                                          : spdlog::level::info;
  const std::string change = e.from == e.to ? "" : std::string(" [") + to_text(e.from) + " -> " + to_text(e.to) + "]";
  const std::string numbers = e.threshold == 0.0 ? "" : fmt::format(" ({:.3f}, limit {:.3f})", e.value, e.threshold);
  spdlog::log(level, "{}: {}{}{}", code, e.text, numbers, change);
}

std::string status_line(const Status& s, const std::string& run) {
  std::string line = to_text(s.control.state);
  if (s.run_loaded) {
    line += fmt::format(": run {}, step {} of {}, {:.0f} %", run, s.control.step + 1, s.steps,
                        100.0 * double{s.control.progress});
  }
  const std::string why = s.fault[0] != '\0' ? s.fault : s.not_ready;
  return why.empty() ? line : line + ": " + why;
}

}  // namespace isorig::daemon
