#pragma once
#include <limits>

#include "base/toml_reader.hpp"

namespace isorig::protocol {

/// What the rig may do: the [limits] table of the rig's file, whole (it has no other readers). The compiler
/// checks a plan against it before anything moves; the supervisor enforces the same numbers while it runs.
/// Default-constructed, nothing is limited.
struct Limits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  /// A travel limit trips this far beyond it, so that a crosshead may stand at the limit: a hundred times the position
  /// noise of the simulated rig, and more than the overshoot of a slow jog.
  static constexpr double kTravelTolerance_mm = 0.02;
  /// A crosshead runs over its target by up to this time of its speed: 8 ms in the simulated rig
  /// (docs/simulated-rig.md), which the paper's exports do not contradict.
  static constexpr double kOverrun_s = 0.01;
  /// At which the pressure loop of a rig file that does not say follows a set-point.
  static constexpr double kLoopRate_psi_s = 10.0;

  /// Of the simulated rig, from waves in virtual time: 0.12 s at 0.4, 0.18 s at 2, 0.22 s at 8 mm/s.
  static constexpr double kTurningTime_s = 0.15;
  static constexpr double kTurningShare = 0.22;

  double travel_min_mm = -kNone;  ///< crosshead relative to the unpressurized rest length, extension positive
  double travel_max_mm = kNone;
  double speed_min_mm_s = 0.0;  ///< slowest segment the frame executes evenly
  double speed_max_mm_s = kNone;
  double force_min_N = -kNone;  ///< tension positive; a little below zero, since a slack specimen cannot push
  double force_max_N = kNone;
  double force_rate_max_N_s = kNone;
  double pressure_max_psi = kNone;         ///< gauge
  double regulator_max_psi = kNone;        ///< of the set-point: [regulator] max_psi, where there is one
  double pressure_rate_max_psi_s = kNone;  ///< of the set-point
  double loop_rate_max_psi_s = kNone;      ///< at which the pressure loop follows it: [pressure_loop] rate_limit_psi_s
  /// Shortest time between two segments that the frame's link sustains; bounds how finely a sine is cut. A
  /// rig file that does not say has 0.05 s.
  double segment_interval_min_s = 0.0;
  /// From the end of a ramp of 1 mm/s until the frame has said that it is there; see turn_s(). A rig file that does not
  /// say has kTurningTime_s.
  double turning_time_s = 0.0;

  /// How long a stroke that arrives at this speed lasts beyond its own time. What is left of the motion rings out, so
  /// that each e-fold of the speed costs as much more: 0.22 of the time at 1 mm/s in the simulated rig.
  [[nodiscard]] double turn_s(double arrival_mm_s) const noexcept;

  /// How far inside a travel limit a target has to lie for the overshoot at this speed not to trip it.
  [[nodiscard]] static constexpr double travel_room_mm(double velocity_mm_s) noexcept {
    const double room_mm = kOverrun_s * velocity_mm_s - kTravelTolerance_mm;
    return room_mm > 0.0 ? room_mm : 0.0;
  }
};

/// Reads [limits]. Errors are noted in the table's document: call its finish().
/// travel, speed_max, force and pressure_max are required: a rig without them is not safe to start.
[[nodiscard]] Limits read_limits(const base::TomlTable& table);

/// All that a rig file says of what a protocol may ask: [limits], [regulator] max_psi and [pressure_loop]
/// rate_limit_psi_s. Leaves the other keys of the latter two to their own readers.
[[nodiscard]] Limits read_rig_limits(const base::TomlTable& root);

}  // namespace isorig::protocol
