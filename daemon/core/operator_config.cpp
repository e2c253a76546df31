#include "daemon/core/operator_config.hpp"

#include <algorithm>

#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {

constexpr double kJogForceShare = 0.1;  // of the range between the two force limits

}  // namespace

OperatorConfig OperatorConfig::defaults(const protocol::Limits& limits, bool on_the_wire) {
  OperatorConfig c;
  c.arming_required = on_the_wire;
  c.jog_speed_max_mm_s = std::min(c.jog_speed_max_mm_s, limits.speed_max_mm_s);
  c.jog_force_max_N = kJogForceShare * (limits.force_max_N - limits.force_min_N);
  return c;
}

OperatorConfig OperatorConfig::read(const base::TomlTable& table, const protocol::Limits& limits, bool on_the_wire) {
  auto c = defaults(limits, on_the_wire);
  c.arming_required =
      table.choice_or("arming", c.arming_required ? "required" : "none", {"required", "none"}) == "required";
  c.countdown_s = table.number_or("countdown_s", c.countdown_s, {1.0, 60.0});
  c.arm_window_s = table.number_or("arm_window_s", c.arm_window_s, {2.0, 120.0});
  c.setup_max_s = table.number_or("setup_max_s", c.setup_max_s, {10.0, 3600.0});
  c.jog_speed_max_mm_s = table.number_or("jog_speed_max_mm_s", c.jog_speed_max_mm_s, base::kPositive);
  if (c.jog_speed_max_mm_s > limits.speed_max_mm_s) {
    table.error("jog_speed_max_mm_s",
                "`jog_speed_max_mm_s` is above [limits] speed_max_mm_s; a jog is slower than a run");
  }
  c.jog_force_max_N = table.number_or("jog_force_max_N", c.jog_force_max_N, base::kPositive);
  c.jog_time_max_s = table.number_or("jog_time_max_s", c.jog_time_max_s, {0.1, 60.0});
  c.jog_with_guard_open = table.boolean_or("jog_with_guard_open", c.jog_with_guard_open);
  c.sign_off_required = table.choice_or("sign_off", "warn", {"warn", "required"}) == "required";
  return c;
}

}  // namespace isorig::daemon
