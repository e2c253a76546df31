#pragma once
#include <algorithm>

#include "daemon/core/status.hpp"

namespace isorig::daemon::test {

/// The set-point in force, as a bound for the true pressure: what the loop regulates to now, or held at last.
class PressureCeiling {
 public:
  /// A set-point that falls faster than the air can leave is no ceiling at once: through the vent valve alone 20 psi
  /// take 5 s, the slowest at the end.
  static constexpr double kFalls_psi_s = 0.5;

  /// `elapsed_s` since the last call. `rises_psi_s`: of the ramp by which the present step goes to its set-point.
  void follow(const LoopStatus& now, double rises_psi_s, double elapsed_s) noexcept {
    const auto& c = now.control;
    const bool regulates = c.state == RunState::kRunning || c.state == RunState::kPaused;
    const double wanted_psi = regulates || c.state == RunState::kFaulted ? double{c.setpoint_psi} : 0.0;
    // A program stop shuts both valves: what it holds may be far above a set-point that had just fallen.
    const double falls_psi_s = c.state == RunState::kFaulted && !now.vented_fault ? 0.0 : kFalls_psi_s;
    psi_ = std::clamp(wanted_psi, psi_ - falls_psi_s * elapsed_s, psi_ + rises_psi_s * elapsed_s);
  }
  [[nodiscard]] double psi() const noexcept { return psi_; }

 private:
  double psi_ = 0.0;
};

}  // namespace isorig::daemon::test
