#pragma once

namespace isorig::model {

/// What every mechanical element sees of a step: the values at its end, and how long it took. Within the
/// step the motion is linear. Signs as everywhere: extension and tension positive, position relative to the
/// unpressurized rest length, strain relative to the pressurized one, pressure gauge.
struct Stroke {
  double position_mm = 0.0;
  double velocity_mm_s = 0.0;  ///< mean over the step
  double strain = 0.0;
  double strain_rate_1_s = 0.0;  ///< mean over the step; includes the change of the rest length with pressure
  double pressure_psi = 0.0;
  double dt_s = 0.0;
};

/// Something in parallel with the actuator's own elements. The force of an actuator is the sum of them all.
class Element {
 public:
  virtual ~Element() = default;
  /// Steady state at `at` (its velocity and dt are 0); returns its force there [N].
  virtual double settle(const Stroke& at) noexcept = 0;
  /// Moves to `to`; returns its force there [N].
  virtual double step(const Stroke& to) noexcept = 0;
};

}  // namespace isorig::model
