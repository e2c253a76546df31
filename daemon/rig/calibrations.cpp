#include "daemon/rig/calibrations.hpp"

#include <algorithm>
#include <cctype>

#include "base/toml_reader.hpp"
#include "calibration/date.hpp"
#include "daemon/rig/config_checks.hpp"

namespace isorig::daemon {

using calibration::Channel;

std::filesystem::path records_of(const RigConfig& rig, const std::filesystem::path& runs_root) {
  if (!rig.calibration.records.empty()) return rig.calibration.records;
  std::string name = rig.name;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)) && c != '-'; }, '-');
  return runs_root / "calibration" / name;
}

calibration::Store open_records(const RigConfig& rig, const std::filesystem::path& runs_root) {
  const auto& c = rig.core.calibration;
  return {records_of(rig, runs_root),
          {calibration::Correction{c.pressure_scale, c.pressure_offset_psi},
           calibration::Correction{c.force_scale, c.force_offset_N},
           calibration::Correction{c.position_scale, c.position_offset_mm}}};
}

Calibration corrections_of(const calibration::Store& store) {
  const auto pressure = store.in_force(Channel::kPressure).correction;
  const auto force = store.in_force(Channel::kForce).correction;
  const auto position = store.in_force(Channel::kPosition).correction;
  return {position.scale, position.offset, force.scale, force.offset, pressure.scale, pressure.offset};
}

RigConfig corrected(RigConfig rig, const Calibration& calibration) {
  rig.core.calibration = calibration;
  return rig;
}

RigConfig with_calibration(RigConfig rig, const std::filesystem::path& runs_root) {
  const auto records = open_records(rig, runs_root);
  rig = corrected(std::move(rig), corrections_of(records));
  if (const auto why = why_no_calibration(rig); !why.empty()) {
    throw base::ConfigError({{records.directory().string(), 0, 0, "the records in force: " + why}});
  }
  rig.services.fill_limits = fill_limits(rig);
  return rig;
}

std::string why_not_in_force(RigConfig rig, const calibration::Record& record) {
  const auto& [scale, offset] = record.result.correction;
  auto& c = rig.core.calibration;
  if (record.channel == Channel::kPressure) {
    c.pressure_scale = scale;
    c.pressure_offset_psi = offset;
  } else if (record.channel == Channel::kForce) {
    c.force_scale = scale;
    c.force_offset_N = offset;
  } else {
    c.position_scale = scale;
    c.position_offset_mm = offset;
  }
  return why_no_calibration(rig);
}

nlohmann::json to_json(const calibration::Store& store) {
  const auto today = calibration::today();
  nlohmann::json all = nlohmann::json::object();
  for (const auto c : calibration::kChannels) {
    const auto f = store.in_force(c);
    nlohmann::json one{
        {"unit", unit_of(c)}, {"scale", f.correction.scale}, {"offset", f.correction.offset}, {"id", ""}};
    if (const auto* r = f.record) {
      one["id"] = r->id;
      one["mode"] = name_of(r->mode);
      one["made_utc"] = r->made_utc;
      one["due"] = r->due;
      one["overdue"] = r->overdue(today);
      one["operator"] = r->operator_name;
      one["reference"] = r->reference.id;
      one["uncertainty_k2"] = r->result.uncertainty;
      one["as_found_max_error"] = r->result.as_found_max;
      one["within_error_band"] = r->result.found_in_band;
    }
    all[name_of(c)] = one;
  }
  return all;
}

}  // namespace isorig::daemon
