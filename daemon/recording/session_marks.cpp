#include "daemon/recording/session_marks.hpp"

#include <cmath>

#include "base/printable.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {
const char* severity_text(const isorig_msgs::event_t& event) noexcept {
  const bool known = event.severity >= isorig_msgs::event_t::INFO && event.severity <= isorig_msgs::event_t::SAFE_STATE;
  return known ? to_text(static_cast<Severity>(event.severity)) : "?";
}

void SessionMarks::write(toml::table& to, std::int64_t start_ns) const {
  toml::array steps, happened;
  for (const auto& e : events) {
    const auto text = base::printable(e.text);  // bytes of a damaged log need not be UTF-8
    const double t_s = static_cast<double>(e.mono_ns - start_ns) * 1e-9;
    if (e.code == "step" || e.code == "mark") {
      steps.push_back(toml::table{{"t_s", t_s}, {"step", e.step}, {e.code == "mark" ? "mark" : "do", text}});
      continue;
    }
    toml::table event{{"t_s", t_s}, {"severity", severity_text(e)}, {"code", base::printable(e.code)}, {"text", text}};
    if (std::isfinite(e.value) && e.value != 0.0) event.insert_or_assign("value", e.value);
    if (std::isfinite(e.threshold) && e.threshold != 0.0) event.insert_or_assign("threshold", e.threshold);
    happened.push_back(std::move(event));
  }
  if (!steps.empty()) to.insert_or_assign("steps", std::move(steps));
  if (!happened.empty()) to.insert_or_assign("events", std::move(happened));
  to.insert_or_assign("missing", toml::table{{"frame_samples", frame_missing}, {"pressure_samples", pressure_missing}});
}

std::pair<std::int64_t, std::int64_t> MissingCounts::since_last(const isorig_msgs::session_mark_t& end) {
  auto& before = before_[end.attempt];
  const std::pair since{end.frame_missing - before.first, end.pressure_missing - before.second};
  before = {end.frame_missing, end.pressure_missing};
  return since;
}

}  // namespace isorig::daemon
