#include "protocol/limits.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::protocol {

double Limits::turn_s(double arrival_mm_s) const noexcept {
  if (!(arrival_mm_s > 0.0)) return 0.0;
  return turning_time_s * std::max(0.0, 1.0 + kTurningShare * std::log(arrival_mm_s));
}

Limits read_limits(const base::TomlTable& table) {
  Limits out;
  out.travel_min_mm = table.number("travel_min_mm", {-Limits::kNone, 0.0});
  out.travel_max_mm = table.number("travel_max_mm", base::kNonNegative);
  out.speed_min_mm_s = table.number_or("speed_min_mm_s", out.speed_min_mm_s, base::kNonNegative);
  out.speed_max_mm_s = table.number("speed_max_mm_s", base::kPositive);
  out.force_min_N = table.number("force_min_N", {-Limits::kNone, 0.0});
  out.force_max_N = table.number("force_max_N", base::kPositive);
  out.force_rate_max_N_s = table.number_or("force_rate_max_N_s", out.force_rate_max_N_s, base::kPositive);
  out.pressure_max_psi = table.number("pressure_max_psi", base::kPositive);
  out.pressure_rate_max_psi_s =
      table.number_or("pressure_rate_max_psi_s", out.pressure_rate_max_psi_s, base::kPositive);
  out.segment_interval_min_s = table.number_or("segment_interval_min_s", 0.05, base::kPositive);
  out.turning_time_s = table.number_or("turning_time_s", Limits::kTurningTime_s, {0.0, 10.0});
  const bool has_speeds =
      table.has("speed_max_mm_s") && !table.is_wrong("speed_max_mm_s") && !table.is_wrong("speed_min_mm_s");
  if (has_speeds && out.speed_min_mm_s > out.speed_max_mm_s) {
    table.error("speed_min_mm_s", "`speed_min_mm_s` is above `speed_max_mm_s`; swap or correct them");
  }
  return out;
}

Limits read_rig_limits(const base::TomlTable& root) {
  Limits out = read_limits(root.table("limits"));
  out.loop_rate_max_psi_s = Limits::kLoopRate_psi_s;
  if (const auto loop = root.table_if("pressure_loop")) {
    loop->ignore_rest();
    out.loop_rate_max_psi_s = loop->number_or("rate_limit_psi_s", out.loop_rate_max_psi_s, base::kPositive);
  }
  if (const auto regulator = root.table_if("regulator")) {
    regulator->ignore_rest();
    out.regulator_max_psi = regulator->number_or("max_psi", out.regulator_max_psi, base::kPositive);
  }
  return out;
}

}  // namespace isorig::protocol
