#include "daemon/export/streams.hpp"

#include <string_view>
#include <utility>

namespace isorig::daemon {
namespace {

constexpr int kNanoseconds = 9;
constexpr const char* kMean = "; the interval's mean where averaged is 1";

Column time_column() {
  return {"t_s", ColumnType::kReal, "s", "time from the session's first sample, of whichever stream", kNanoseconds};
}

/// The mean of n readings that scatter over their step is known to step / sqrt(12 n) or so, 0.02 steps for the 250 of
/// an interval: it is written with a decimal more than a reading.
constexpr int kDecimalsOfMean = 1;

/// Of intervals the least or the largest reading.
Column extreme(const char* name, const char* unit, std::string description, double step, Attributes calibration) {
  if (step > 0.0) calibration.emplace_back("resolution", step);
  return {name, ColumnType::kReal, unit, std::move(description), decimals_for(step), std::move(calibration)};
}

/// The quantity itself, or of intervals its mean.
Column measured(const char* name, const char* unit, const std::string& description, double step,
                Attributes calibration) {
  auto column = extreme(name, unit, description + kMean, step, std::move(calibration));
  column.decimals += kDecimalsOfMean;
  return column;
}

/// A reading keeps the decimals that its device's step is worth.
double mean_or_reading(const Table& block, std::size_t column, double value, bool averaged) {
  return averaged ? value : rounded(value, block.schema().columns[column].decimals - kDecimalsOfMean);
}

Attributes calibration_of(const toml::table& all, std::string_view channel) {
  Attributes out;
  const auto* table = all[channel].as_table();
  if (table == nullptr) return out;
  for (const auto& [key, node] : *table) {
    const std::string name = attribute_name("calibration_" + std::string(key.str()));
    if (const auto text = node.value_exact<std::string>()) {
      out.emplace_back(name, *text);
    } else if (const auto number = node.value<double>()) {
      out.emplace_back(name, *number);
    }
  }
  return out;
}

/// Behind what was measured, the same in frame and pressure.
void add_common(std::vector<Column>& to, bool remapped) {
  const std::string of_which = remapped
                                   ? "; of the offline mapping, or of the online one in a row that kept its online time"
                                   : "; of the online mapping";
  to.push_back({"averaged", ColumnType::kFlag, "", "0: a full sample; 1: an interval, at the middle of its time"});
  to.push_back({"samples", ColumnType::kSmall, "", "current samples in the row; 1 of a full sample"});
  to.push_back({"step", ColumnType::kSmall, "", "of the plan, as in the tables steps, ramps and holds; -1 outside"});
  to.push_back({"mono_ns", ColumnType::kWhole, "ns", "CLOCK_MONOTONIC of the rig's computer"});
  to.push_back({"bound_ns", ColumnType::kReal, "ns", "the error of mono_ns lies within +- this" + of_which, 0});
  to.push_back(
      {"repeatability_ns", ColumnType::kReal, "ns", "scatter of mono_ns, one standard deviation" + of_which, 0});
  to.push_back({"device_us", ColumnType::kReal, "us", "the device's own clock; of an interval its middle", 1});
  to.push_back({"sequence", ColumnType::kReal, "", "the device's sample counter; of an interval its middle", 1});
}

void fill_common(Table& block, const Row& row) {
  block.whole(row.averaged ? 1 : 0).whole(row.samples).whole(row.step).whole(row.mono_ns).real(row.bound_ns);
  block.real(row.repeatability_ns).real(row.device_us).real(row.sequence);
}

TableSchema frame_schema(const StreamOrigin& from) {
  const auto position = calibration_of(from.calibration, "position"), force = calibration_of(from.calibration, "force");
  const double mm = from.position_step, newton = from.force_step;
  TableSchema s{"frame", "crosshead position and force of the testing frame", {time_column()}};
  s.columns.push_back(measured(
      "position_mm", "mm", "measured crosshead position relative to the unpressurized rest length, extension positive",
      mm, position));
  s.columns.push_back(measured("force_N", "N", "force, tension positive", newton, force));
  s.columns.push_back(extreme("position_min_mm", "mm", "least position of an interval", mm, position));
  s.columns.push_back(extreme("position_max_mm", "mm", "largest position of an interval", mm, position));
  s.columns.push_back(extreme("force_min_N", "N", "least force of an interval", newton, force));
  s.columns.push_back(extreme("force_max_N", "N", "largest force of an interval", newton, force));
  add_common(s.columns, from.remapped);
  s.attributes.emplace_back("device", from.frame_device);
  return s;
}

TableSchema pressure_schema(const StreamOrigin& from) {
  const auto calibration = calibration_of(from.calibration, "pressure");
  const double psi = from.pressure_step;
  TableSchema s{"pressure", "pressure in the actuator", {time_column()}};
  s.columns.push_back(measured("pressure_psi", "psi", "gauge pressure", psi, calibration));
  s.columns.push_back(extreme("pressure_min_psi", "psi", "least pressure of an interval", psi, calibration));
  s.columns.push_back(extreme("pressure_max_psi", "psi", "largest pressure of an interval", psi, calibration));
  // One count of the sensor's 11 bits over 200 degrees (messages/elvh.hpp).
  s.columns.push_back({"temperature_C", ColumnType::kReal, "degC", std::string("of the pressure sensor") + kMean,
                       decimals_for(200.0 / 2047.0) + kDecimalsOfMean});
  add_common(s.columns, from.remapped);
  s.attributes.emplace_back("device", from.pressure_device);
  return s;
}

TableSchema setpoint_schema() {
  TableSchema s{"setpoints",
                "what the controller wanted and did, as recorded: 100 Hz in full stretches, else once per "
                "averaging interval",
                {time_column()}};
  const auto single = [](const char* name, const char* unit, const char* what, int decimals) {
    return Column{name, ColumnType::kReal, unit, what, decimals};
  };
  s.columns.push_back(single("setpoint_psi", "psi", "set-point of the pressure, gauge", 5));
  s.columns.push_back(single("target_mm", "mm", "where the frame is sent", 6));
  s.columns.push_back(single("velocity_mm_s", "mm/s", "how fast it is sent there, a magnitude", 6));
  s.columns.push_back({"fill_permille", ColumnType::kSmall, "permille", "opening of the fill valve"});
  s.columns.push_back({"vent_permille", ColumnType::kSmall, "permille", "opening of the vent valve"});
  s.columns.push_back({"state", ColumnType::kFlag, "",
                       "0 idle, 1 ready, 2 running, 3 paused, 4 stopping, 5 faulted, 6 armed, 7 countdown, 8 setup"});
  s.columns.push_back({"step", ColumnType::kSmall, "", "of the plan, as in the tables steps, ramps and holds"});
  s.columns.push_back({"mono_ns", ColumnType::kWhole, "ns", "CLOCK_MONOTONIC of the rig's computer"});
  s.attributes.emplace_back("device", std::string("isorigd"));
  return s;
}

}  // namespace

StreamOrigin origin_of(const isorig_msgs::run_header_t& header, const Scan& scan) {
  StreamOrigin from;
  from.frame_device = from.pressure_device = header.rig;
  for (const auto& v : header.versions) {
    if (v.name == "frame") from.frame_device = v.text;
    if (v.name == "pressure") from.pressure_device = v.text;
  }
  for (const auto& t : header.texts) {
    if (t.name == "calibration.toml") from.calibration = toml::parse(t.text);
  }
  from.position_step = scan.position_step.value();
  from.force_step = scan.force_step.value();
  from.pressure_step = scan.pressure_step.value();
  return from;
}

TableSchema schema_of(Stream stream, const StreamOrigin& origin) {
  switch (stream) {
    case Stream::kFrame:
      return frame_schema(origin);
    case Stream::kPressure:
      return pressure_schema(origin);
    case Stream::kSetpoints:
      break;
  }
  return setpoint_schema();
}

void fill(Table& block, Stream stream, const Row& row, std::int64_t start_ns) {
  // The double nearest to the decimal number of nanoseconds, as it is read back from a CSV.
  block.real(static_cast<double>(row.mono_ns - start_ns) / 1e9);
  const auto& v = row.value;
  const auto value = [&](std::size_t column, double x) { return mean_or_reading(block, column, x, row.averaged); };
  switch (stream) {
    case Stream::kFrame:
      block.real(value(1, v[0])).real(value(2, v[1])).real(v[2]).real(v[3]).real(v[4]).real(v[5]);
      fill_common(block, row);
      break;
    case Stream::kPressure:
      block.real(value(1, v[0])).real(v[1]).real(v[2]).real(value(4, v[3]));
      fill_common(block, row);
      break;
    case Stream::kSetpoints:
      block.real(v[0]).real(v[1]).real(v[2]);
      for (const std::size_t i : {3U, 4U, 5U}) block.whole(static_cast<std::int64_t>(v[i]));
      block.whole(row.step).whole(row.mono_ns);
      break;
  }
  block.end_row();
}

}  // namespace isorig::daemon
