#pragma once
#include <limits>

#include "base/toml_reader.hpp"

namespace isorig::protocol {

/// What the rig may do: the [limits] table of the rig's file, whole (it has no other readers). The compiler
/// checks a plan against it before anything moves; the supervisor enforces the same numbers while it runs.
/// Default-constructed, nothing is limited.
struct Limits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();

  double travel_min_mm = -kNone;  ///< crosshead relative to the unpressurized rest length, extension positive
  double travel_max_mm = kNone;
  double speed_min_mm_s = 0.0;  ///< slowest segment the frame executes evenly
  double speed_max_mm_s = kNone;
  double force_min_N = -kNone;  ///< tension positive; a little below zero, since a slack specimen cannot push
  double force_max_N = kNone;
  double force_rate_max_N_s = kNone;
  double pressure_max_psi = kNone;         ///< gauge
  double pressure_rate_max_psi_s = kNone;  ///< of the set-point
  /// Shortest time between two segments that the frame's link sustains; bounds how finely a sine is cut. A
  /// rig file that does not say has 0.05 s.
  double segment_interval_min_s = 0.0;
};

/// Reads [limits]. Errors are noted in the table's document: call its finish().
/// travel, speed_max, force and pressure_max are required: a rig without them is not safe to start.
[[nodiscard]] Limits read_limits(const base::TomlTable& table);

}  // namespace isorig::protocol
