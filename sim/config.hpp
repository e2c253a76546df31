#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>

#include "base/toml_reader.hpp"
#include "model/composed.hpp"

/// The [sim] tables of a rig's file. Every default is the value the shipped virtual rig uses; where it comes
/// from is in docs/simulated-rig.md.
namespace isorig::sim {

/// One way of a time exchange: `base`, plus an exponential tail, plus now and then a spike.
struct DelayParameters {
  double base_ms = 0.25;
  double tail_ms = 0.3;
  double spike_probability = 0.01;
  double spike_ms = 5.0;
};

/// A device's clock against CLOCK_MONOTONIC: rate error = skew + a first-order Gauss-Markov process.
struct DeviceClockParameters {
  double offset_us = 0.0;  ///< what it shows at the rig's time zero
  double skew_ppm = 0.0;
  double wander_ppm = 1.0;       ///< rms
  double wander_time_s = 600.0;  ///< correlation time
};

struct FrameParameters {
  // Motion (defaults: fitted to the export of a real frame at 10 mm/s, see Crosshead).
  double lag_ms = 9.77;                 ///< steady delay behind the commanded ramp
  double servo_decay_1_s = 25.5;        ///< real part of the closed loop's pole pair
  double servo_frequency_rad_s = 15.0;  ///< imaginary part
  double acceleration_max_mm_s2 = 600.0;
  double brake_mm_s2 = 2000.0;  ///< deceleration once the drive is disabled
  double speed_max_mm_s = 10.0;
  double travel_min_mm = -12.0;  ///< the frame's own limits, outside those of the daemon
  double travel_max_mm = 12.0;
  double force_min_N = -30.0;
  double force_max_N = 150.0;
  double in_position_mm = 0.002;
  double heartbeat_timeout_s = 0.5;
  double command_delay_ms = 2.0;  ///< from the write to the start of motion
  // Measurement.
  double zero_mm = 0.0;  ///< what the crosshead counts at the unpressurized rest length
  double sample_rate_hz = 1000.0;
  int ring_samples = 256;
  double force_noise_N = 0.01;  ///< rms, white
  double force_quantum_N = 0.001;
  double force_drift_N_h = 0.0;
  double force_gain = 1.0;  ///< of the load cell: it shows gain * force + offset
  double force_offset_N = 0.0;
  double position_gain = 1.0;         ///< of the crosshead's scale, in what it shows and in what it is told
  double position_noise_mm = 0.0002;  ///< rms, white
  double position_quantum_mm = 0.0001;
  DeviceClockParameters clock{1.0e6, -12.0, 1.0, 600.0};
  DelayParameters request, reply;
  double exchange_interval_ms = 250.0;  ///< polls closer than this to the last exchange carry none
  int exchange_burst = 50;              ///< so many first polls carry one each
};

struct SensorParameters {
  double sample_rate_hz = 1000.0;
  double noise_counts = 1.0;  ///< rms, white, before rounding
  double offset_psi = 0.0;    ///< of the sensor, inside its total error band
  double gain = 1.0;          ///< it shows gain * pressure + offset
  double temperature_C = 23.0;
  double temperature_swing_C = 0.5;  ///< slow sine, 2 h
  int ring_samples = 512;
  DeviceClockParameters clock{3.0e6, 18.0, 1.0, 600.0};
  DelayParameters request, reply;
  double turnaround_us = 20.0;
  double sample_latency_ms = 0.3;      ///< from conversion to the host
  double command_delay_ms = 1.5;       ///< from command() to the valve driver
  double command_validity_ms = 100.0;  ///< a valve command that is not renewed by then closes both valves
  double watchdog_s = 0.5;
};

/// Orifices: sonic conductance C [L/(s bar)] of ANR air and critical pressure ratio b, ISO 6358-1.
struct PneumaticParameters {
  double ambient_bar = 1.01325;
  double tank_psi = 90.0;          ///< upstream of the regulator
  double supply_psi = 45.0;        ///< regulator's set pressure at no flow
  double supply_volume_mL = 50.0;  ///< between regulator and fill valve
  double regulator_L_s_bar = 0.8;  ///< flow per bar of droop
  double fill_conductance_L_s_bar = 0.03;
  double vent_conductance_L_s_bar = 0.03;
  double dump_conductance_L_s_bar = 0.2;
  double critical_ratio = 0.4;
  double manifold_volume_mL = 150.0;  ///< buffer and tubing, everything but the actuator
  double leak_mL_s_bar = 0.07;        ///< laminar: ANR flow per bar of gauge pressure
  double valve_time_ms = 4.0;         ///< first-order opening
  double valve_delay_ms = 3.0;        ///< dead time of the valve itself
  double duty_dead_permille = 20.0;   ///< below this a valve stays shut
  double duty_step_permille = 2.0;    ///< resolution of the valve's PWM
  double dump_time_ms = 15.0;
};

/// Physics beyond the specimen's own: parts of the catalogue (model/catalogue.hpp) from an "isorig-model/1"
/// file.
struct PhysicsConfig {
  model::ModelSpec spec;
  /// False: the parts are effects, added to the specimen's actuator. True: the parts are the whole specimen,
  /// such as a model that was identified; the actuator is left with its volume.
  bool replaces_actuator = false;
  double nominal_pressure_psi = 15.0;  ///< at which the model was identified; effects of pressure count from here
};

struct SimConfig {
  std::uint64_t seed = 1;
  std::filesystem::path specimen;  ///< absolute, or relative to the working directory once read
  FrameParameters frame;
  SensorParameters pressure;
  PneumaticParameters pneumatics;
  std::optional<PhysicsConfig> physics;
};

/// Reads [sim] from the rig's root table; a path in it is relative to `directory`. Errors are noted in the
/// document: call its finish().
[[nodiscard]] SimConfig read_sim(const base::TomlTable& root, const std::filesystem::path& directory);
/// The [sim] tables of a rig file, ignoring all others. Throws base::ConfigError.
[[nodiscard]] SimConfig load_sim(const std::filesystem::path& rig_file);

}  // namespace isorig::sim
