#include "sim/config.hpp"

namespace isorig::sim {
namespace {

using base::kNonNegative;
using base::kPositive;
using base::TomlTable;

void read_number(const std::optional<TomlTable>& table, std::string_view key, double& value, base::Range range = {}) {
  if (table) value = table->number_or(key, value, range);
}
void read_count(const std::optional<TomlTable>& table, std::string_view key, int& value, base::Range range) {
  if (table) value = static_cast<int>(table->integer_or(key, value, range));
}

void read_delay(const std::optional<TomlTable>& table, DelayParameters& d) {
  read_number(table, "base_ms", d.base_ms, kNonNegative);
  read_number(table, "tail_ms", d.tail_ms, kNonNegative);
  read_number(table, "spike_probability", d.spike_probability, {0.0, 1.0});
  read_number(table, "spike_ms", d.spike_ms, kNonNegative);
}

void read_clock(const std::optional<TomlTable>& table, DeviceClockParameters& c) {
  read_number(table, "offset_us", c.offset_us, kNonNegative);
  read_number(table, "skew_ppm", c.skew_ppm, {-1000.0, 1000.0});
  read_number(table, "wander_ppm", c.wander_ppm, {0.0, 100.0});
  read_number(table, "wander_time_s", c.wander_time_s, kPositive);
}

std::optional<TomlTable> inner(const std::optional<TomlTable>& table, std::string_view key) {
  return table ? table->table_if(key) : std::nullopt;
}

void read_frame(const std::optional<TomlTable>& t, FrameParameters& f) {
  read_number(t, "lag_ms", f.lag_ms, kPositive);
  read_number(t, "servo_decay_1_s", f.servo_decay_1_s, kPositive);
  read_number(t, "servo_frequency_rad_s", f.servo_frequency_rad_s, kPositive);
  read_number(t, "acceleration_max_mm_s2", f.acceleration_max_mm_s2, kPositive);
  read_number(t, "brake_mm_s2", f.brake_mm_s2, kPositive);
  read_number(t, "speed_max_mm_s", f.speed_max_mm_s, kPositive);
  read_number(t, "travel_min_mm", f.travel_min_mm);
  read_number(t, "travel_max_mm", f.travel_max_mm);
  read_number(t, "force_min_N", f.force_min_N);
  read_number(t, "force_max_N", f.force_max_N);
  read_number(t, "in_position_mm", f.in_position_mm, kPositive);
  read_number(t, "heartbeat_timeout_s", f.heartbeat_timeout_s, kPositive);
  read_number(t, "command_delay_ms", f.command_delay_ms, kNonNegative);
  read_number(t, "zero_mm", f.zero_mm);
  read_number(t, "sample_rate_hz", f.sample_rate_hz, {1.0, 5000.0});
  read_count(t, "ring_samples", f.ring_samples, {2, 65536});
  read_number(t, "force_noise_N", f.force_noise_N, kNonNegative);
  read_number(t, "force_quantum_N", f.force_quantum_N, kPositive);
  read_number(t, "force_drift_N_h", f.force_drift_N_h);
  read_number(t, "force_gain", f.force_gain, {0.5, 2.0});
  read_number(t, "force_offset_N", f.force_offset_N);
  read_number(t, "position_gain", f.position_gain, {0.5, 2.0});
  read_number(t, "position_noise_mm", f.position_noise_mm, kNonNegative);
  read_number(t, "position_quantum_mm", f.position_quantum_mm, kPositive);
  read_number(t, "exchange_interval_ms", f.exchange_interval_ms, kNonNegative);
  read_count(t, "exchange_burst", f.exchange_burst, kNonNegative);
  read_clock(inner(t, "clock"), f.clock);
  read_delay(inner(t, "request"), f.request);
  read_delay(inner(t, "reply"), f.reply);
}

void read_sensor(const std::optional<TomlTable>& t, SensorParameters& s) {
  read_number(t, "sample_rate_hz", s.sample_rate_hz, {1.0, 5000.0});
  read_number(t, "noise_counts", s.noise_counts, kNonNegative);
  read_number(t, "offset_psi", s.offset_psi, {-1.0, 1.0});
  read_number(t, "gain", s.gain, {0.5, 2.0});
  read_number(t, "temperature_C", s.temperature_C, {-50.0, 150.0});
  read_number(t, "temperature_swing_C", s.temperature_swing_C, kNonNegative);
  read_count(t, "ring_samples", s.ring_samples, {2, 65536});
  read_number(t, "turnaround_us", s.turnaround_us, kNonNegative);
  read_number(t, "sample_latency_ms", s.sample_latency_ms, kNonNegative);
  read_number(t, "command_delay_ms", s.command_delay_ms, kNonNegative);
  read_number(t, "command_validity_ms", s.command_validity_ms, {20.0, 5000.0});
  read_number(t, "watchdog_s", s.watchdog_s, kPositive);
  read_clock(inner(t, "clock"), s.clock);
  read_delay(inner(t, "request"), s.request);
  read_delay(inner(t, "reply"), s.reply);
}

void read_pneumatics(const std::optional<TomlTable>& t, PneumaticParameters& p) {
  read_number(t, "ambient_bar", p.ambient_bar, kPositive);
  read_number(t, "tank_psi", p.tank_psi, kNonNegative);
  read_number(t, "supply_psi", p.supply_psi, kNonNegative);
  read_number(t, "supply_volume_mL", p.supply_volume_mL, {5.0, 1e5});
  read_number(t, "regulator_L_s_bar", p.regulator_L_s_bar, kPositive);
  read_number(t, "fill_conductance_L_s_bar", p.fill_conductance_L_s_bar, kPositive);
  read_number(t, "vent_conductance_L_s_bar", p.vent_conductance_L_s_bar, kPositive);
  read_number(t, "dump_conductance_L_s_bar", p.dump_conductance_L_s_bar, kPositive);
  read_number(t, "critical_ratio", p.critical_ratio, {0.0, 0.9});
  read_number(t, "manifold_volume_mL", p.manifold_volume_mL, {5.0, 1e5});
  read_number(t, "leak_mL_s_bar", p.leak_mL_s_bar, kNonNegative);
  read_number(t, "valve_time_ms", p.valve_time_ms, kPositive);
  read_number(t, "valve_delay_ms", p.valve_delay_ms, kNonNegative);
  read_number(t, "duty_dead_permille", p.duty_dead_permille, {0.0, 500.0});
  read_number(t, "duty_step_permille", p.duty_step_permille, {1.0, 500.0});
  read_number(t, "dump_time_ms", p.dump_time_ms, kPositive);
}

// [sim.physics]: effects = "FILE" or model = "FILE", and nominal_pressure_psi.
std::optional<PhysicsConfig> read_physics(const std::optional<TomlTable>& t, const std::filesystem::path& directory) {
  if (!t) return std::nullopt;
  PhysicsConfig physics;
  const bool effects = t->has("effects");
  const bool model = t->has("model");
  const std::string effects_file = t->string_or("effects", "");
  const std::string model_file = t->string_or("model", "");
  physics.nominal_pressure_psi = t->number("nominal_pressure_psi", kNonNegative);
  if (effects == model) {
    t->error(model ? "model" : "", "needs either `effects` (added to the specimen) or `model` (in its place)");
    return std::nullopt;
  }
  physics.replaces_actuator = model;
  try {
    physics.spec = model::read_model((directory / (model ? model_file : effects_file)).lexically_normal());
  } catch (const base::ConfigError& e) {
    for (const auto& fault : e.diagnostics()) t->error(model ? "model" : "effects", fault.text());
  }
  return physics;
}

}  // namespace

SimConfig read_sim(const TomlTable& root, const std::filesystem::path& directory) {
  SimConfig config;
  const TomlTable sim = root.table("sim");
  config.seed = static_cast<std::uint64_t>(sim.integer_or("seed", 1, kNonNegative));
  const std::filesystem::path specimen = sim.string("specimen");
  config.specimen = specimen.is_absolute() ? specimen : (directory / specimen).lexically_normal();
  read_frame(sim.table_if("frame"), config.frame);
  read_sensor(sim.table_if("pressure"), config.pressure);
  read_pneumatics(sim.table_if("pneumatics"), config.pneumatics);
  config.physics = read_physics(sim.table_if("physics"), directory);
  if (const auto t = sim.table_if("controller")) t->ignore_rest();  // of an emulator on the wire
  return config;
}

SimConfig load_sim(const std::filesystem::path& rig_file) {
  const auto document = base::TomlDocument::parse_file(rig_file);
  const TomlTable root = document.root();
  SimConfig config = read_sim(root, std::filesystem::weakly_canonical(rig_file).parent_path());
  root.ignore_rest();
  document.finish();
  return config;
}

}  // namespace isorig::sim
