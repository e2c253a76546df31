#include "daemon/export/metadata.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "base/formatted.hpp"

namespace isorig::daemon {
namespace {

/// Digits before the point.
int digits_of(double value) {
  return value >= 1.0 ? static_cast<int>(std::floor(std::log10(value) + 1e-12)) + 1 : 1;
}

toml::table provenance_table(const Provenance& from) {
  const auto& header = *from.header;
  const auto& options = *from.options;
  toml::table versions;
  for (const auto& v : header.versions) versions.insert_or_assign(v.name, v.text);
  toml::table out{{"run", options.run_id},
                  {"rig", header.rig},
                  {"virtual_time", header.virtual_time != 0},
                  {"seed", header.seed},
                  {"plan", header.plan_summary},
                  {"time_mapping", options.remap ? "offline" : "online"},
                  {"average_interval_s", header.average_interval_s},
                  {"versions", versions},
                  {"recording_state", messages::to_text(from.state)}};
  toml::array complaints;
  for (const auto& line : from.complaints) complaints.push_back(line);
  if (!complaints.empty()) out.insert_or_assign("recording_complaints", complaints);
  if (!options.run_directory.empty()) out.insert_or_assign("run_directory", options.run_directory.string());
  if (!options.outcome.empty()) out.insert_or_assign("outcome", options.outcome);
  if (!options.operator_name.empty()) out.insert_or_assign("operator", options.operator_name);
  for (const auto& t : header.texts) {
    if (t.name == "operator") out.insert_or_assign("operator", t.text);
    // What corrected these values; the raw ones are in the run.
    if (t.name == "calibration.toml") out.insert_or_assign("calibration", toml::parse(t.text));
  }
  return out;
}

/// Single values under their key, those of tables under table_key: formats' attributes do not nest.
void flatten(Attributes& to, const toml::table& from, const std::string& before) {
  for (const auto& [key, node] : from) {
    const std::string name = attribute_name(before + std::string(key.str()));
    if (const auto* table = node.as_table()) {
      flatten(to, *table, name + "_");
    } else if (const auto text = node.value_exact<std::string>()) {
      to.emplace_back(name, *text);
    } else if (const auto whole = node.value_exact<std::int64_t>()) {
      to.emplace_back(name, *whole);
    } else if (const auto number = node.value_exact<double>()) {
      to.emplace_back(name, *number);
    } else if (const auto flag = node.value_exact<bool>()) {
      to.emplace_back(name, std::int64_t{*flag});
    } else if (const auto* list = node.as_array(); list != nullptr && !list->empty() && list->front().is_string()) {
      std::string lines;
      for (const auto& line : *list) lines += (lines.empty() ? "" : "\n") + line.value_or(std::string());
      to.emplace_back(name, lines);
    }
  }
}

std::string padded_name(const isorig_msgs::session_t& s, int repetition_digits, int pressure_digits) {
  if (s.repetition <= 0 || !std::isfinite(s.pressure_psi)) return "session-" + std::to_string(s.session);
  const int missing = std::max(0, pressure_digits - digits_of(s.pressure_psi));
  const std::string zeros(static_cast<std::size_t>(missing), '0');
  return base::formatted("rep-%0*d_%s%g-psi", repetition_digits, s.repetition, zeros.c_str(), s.pressure_psi);
}

std::string told_apart(const std::string& name, std::int32_t session) {
  return name + "_session-" + std::to_string(session);
}

}  // namespace

void describe_session(SessionTail& tail, const Provenance& from, const isorig_msgs::session_t& planned,
                      const ExportedSession& e, const SessionMarks& marks, std::int64_t start_ns) {
  const auto& header = *from.header;
  auto& m = tail.metadata;
  m.units_stated = true;
  const auto& noted = from.options->noted;
  m.specimen = noted ? noted->specimen : header.specimen;
  const double rest_length_mm = noted ? noted->rest_length_mm : header.rest_length_mm;
  if (rest_length_mm > 0.0) m.rest_length_mm = rest_length_mm;
  double pressurized_mm = planned.pressurized_rest_length_mm;
  if (noted) {
    const auto& length = noted->pressurized_rest_length_mm;
    pressurized_mm = length && std::isfinite(planned.pressure_psi) ? length(planned.pressure_psi)
                                                                   : std::numeric_limits<double>::quiet_NaN();
  }
  if (std::isfinite(pressurized_mm)) m.pressurized_rest_length_mm = pressurized_mm;
  if (std::isfinite(planned.pressure_psi)) m.nominal_pressure_psi = planned.pressure_psi;
  auto further = provenance_table(from);
  further.insert_or_assign("session", e.session);
  further.insert_or_assign("repetition", e.repetition);
  further.insert_or_assign("attempt", e.attempt);
  further.insert_or_assign("complete", e.complete);
  further.insert_or_assign("start_mono_ns", start_ns);
  if (header.epoch_unix_us != 0) further.insert_or_assign("start_unix_us", header.epoch_unix_us + start_ns / 1000);
  if (from.options->remap) {
    further.insert_or_assign("rows_with_online_time", static_cast<std::int64_t>(e.kept_online));
  }
  auto& attributes = tail.attributes;
  attributes.emplace_back("specimen", m.specimen);
  if (m.rest_length_mm) attributes.emplace_back("rest_length_mm", *m.rest_length_mm);
  if (m.pressurized_rest_length_mm)
    attributes.emplace_back("pressurized_rest_length_mm", *m.pressurized_rest_length_mm);
  if (m.nominal_pressure_psi) attributes.emplace_back("nominal_pressure_psi", *m.nominal_pressure_psi);
  flatten(attributes, further, {});
  attributes.emplace_back("missing_frame_samples", marks.frame_missing);
  attributes.emplace_back("missing_pressure_samples", marks.pressure_missing);
  marks.write(further, start_ns);
  std::ostringstream text;
  text << further << '\n';
  m.further_toml = text.str();
}

Attributes describe_run(const Provenance& from) {
  const auto& noted = from.options->noted;
  const double rest_length_mm = noted ? noted->rest_length_mm : from.header->rest_length_mm;
  Attributes out{{"specimen", noted ? noted->specimen : from.header->specimen}};
  if (rest_length_mm > 0.0) out.emplace_back("rest_length_mm", rest_length_mm);
  flatten(out, provenance_table(from), {});
  return out;
}

SessionNames::SessionNames(const std::vector<isorig_msgs::session_t>& planned) {
  for (const auto& s : planned) {
    repetition_digits_ = std::max(repetition_digits_, digits_of(static_cast<double>(s.repetition)));
    if (std::isfinite(s.pressure_psi)) pressure_digits_ = std::max(pressure_digits_, digits_of(s.pressure_psi));
  }
  for (const auto& s : planned) {
    auto name = padded_name(s, repetition_digits_, pressure_digits_);
    // Two sessions of a plan may have the same repetition and pressure.
    if (!taken_.insert(name).second) taken_.insert(name = told_apart(name, s.session));
    name_of_[s.session] = name;
  }
}

std::set<std::string> SessionNames::former(const isorig_msgs::session_t& planned) const {
  std::set<std::string> names;
  for (int r = 1; r <= repetition_digits_; ++r) {
    for (int p = 1; p <= pressure_digits_; ++p) {
      const auto name = padded_name(planned, r, p);
      names.insert({name, told_apart(name, planned.session)});
    }
  }
  for (const auto& name : taken_) names.erase(name);
  return names;
}

}  // namespace isorig::daemon
