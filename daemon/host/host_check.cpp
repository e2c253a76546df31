#include <nlohmann/json.hpp>

#include "daemon/host/host.hpp"
#include "protocol/compile.hpp"

/// Host: what a protocol would do on this rig, as `isorig check` says it.
namespace isorig::daemon {
namespace {

using nlohmann::json;

/// Described in words; a plan may have 50,000 steps, and nobody reads them all.
constexpr std::size_t kTexts = 1000;

/// A column for each quantity: a fifth of what an object for each step takes.
json columns_of(const protocol::Plan& plan) {
  json kind = json::array(), session = json::array(), start = json::array(), nominal = json::array(),
       worst = json::array(), before = json::array(), after = json::array(), amplitude = json::array(),
       pressure = json::array(), rate = json::array(), line = json::array(), text = json::array();
  for (const auto& s : plan.steps) {
    kind.push_back(protocol::name_of(s.kind));
    session.push_back(s.session == protocol::kNoSession ? json() : json(s.session));
    start.push_back(s.start_s);
    nominal.push_back(s.nominal_s);
    worst.push_back(s.worst_s);
    before.push_back(s.position_before_mm);
    after.push_back(s.position_after_mm);
    amplitude.push_back(s.amplitude_mm);
    pressure.push_back(s.pressure_psi);
    rate.push_back(s.rate_psi_s);
    line.push_back(s.line);
    if (text.size() < kTexts) text.push_back(protocol::describe(s));
  }
  return {{"do", std::move(kind)},
          {"session", std::move(session)},
          {"start_s", std::move(start)},
          {"nominal_s", std::move(nominal)},
          {"worst_s", std::move(worst)},
          {"position_before_mm", std::move(before)},
          {"position_after_mm", std::move(after)},
          {"amplitude_mm", std::move(amplitude)},
          {"pressure_psi", std::move(pressure)},
          {"rate_psi_s", std::move(rate)},
          {"line", std::move(line)},
          {"text", std::move(text)}};
}

}  // namespace

json Host::check_json(const std::string& protocol_text, const std::string& protocol_name) const {
  const auto plan = protocol::compile(base::TomlDocument::parse_text(protocol_text, protocol_name), rig_.limits);
  json sessions = json::array();
  for (const auto& s : plan.sessions) sessions.push_back(s.label);
  json warnings = json::array();
  for (auto& text : overdue()) {
    warnings.push_back("calibration " + std::string(rig_.calibration.refuse_overdue ? "REFUSED" : "WARNING") + ": " +
                       std::move(text));
  }
  for (const auto& text : plan.warnings) warnings.push_back("WARNING: " + text);
  return {{"ok", true},
          {"text", protocol_name + " is well: " + plan.name},
          {"rig", rig_.name},
          {"protocol", plan.name},
          {"description", plan.description},
          {"nominal_s", plan.nominal_s},
          {"worst_s", plan.worst_s},
          {"full_rate_s", plan.full_rate_s},
          {"average_interval_s", plan.recording.average_interval_s},
          {"travel_mm", plan.travel_mm},
          {"peak_speed_mm_s", plan.peak_speed_mm_s},
          {"position_min_mm", plan.position_min_mm},
          {"position_max_mm", plan.position_max_mm},
          {"pressure_max_psi", plan.pressure_max_psi},
          {"sessions", std::move(sessions)},
          {"warnings", std::move(warnings)},
          {"steps", columns_of(plan)}};
}

}  // namespace isorig::daemon
