#pragma once

#include "protocol/limits.hpp"

namespace isorig::base {
class TomlTable;
}

namespace isorig::daemon {

/// What stands between a person's command and a motion: [operator] of the rig file (docs/config.md).
struct OperatorConfig {
  bool arming_required = false;     ///< a start is two acts and a countdown; else the rig moves at once
  double countdown_s = 5.0;         ///< between the second act and the first motion or pressure
  double arm_window_s = 10.0;       ///< for the second act
  double setup_max_s = 600.0;       ///< without an act for longer: setup is left
  double jog_speed_max_mm_s = 1.0;  ///< half of it with the guard open
  double jog_force_max_N = protocol::Limits::kNone;  ///< either way: a jog that reaches it ends
  double jog_time_max_s = 5.0;  ///< of one command: nobody holds a key down for longer without knowing
  bool jog_with_guard_open = false;
  bool sign_off_required = false;  ///< no start while the rig file differs from what was accepted

  /// For a rig with these limits whose file has no [operator].
  [[nodiscard]] static OperatorConfig defaults(const protocol::Limits& limits, bool on_the_wire);
  /// Reads [operator].
  [[nodiscard]] static OperatorConfig read(const base::TomlTable& table, const protocol::Limits& limits,
                                           bool on_the_wire);
};

}  // namespace isorig::daemon
