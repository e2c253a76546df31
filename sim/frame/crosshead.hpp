#pragma once
#include <cstdint>

#include "sim/config.hpp"

namespace isorig::sim {

/// Motion of the crosshead: a reference that ramps to the target at constant speed, and a servo that follows.
///
///   x'' = wn^2 (r - x + b r' - a x'),  |x''| <= acceleration_max
///   wn^2 = s^2 + w^2,  a = 2 s / wn^2,  b = a - lag
///
/// with poles -s +- i w. A ramp is followed at the ramp's speed and a constant delay (`lag`); before that the
/// crosshead starts slowly and runs fast for a moment, and it overshoots a little when the reference stops.
/// Defaults: s = 25.5 1/s, w = 15 rad/s, lag 9.77 ms, fitted to what a real Instron did at 10 mm/s, where the
/// deficit against an ideal ramp was 0.136 mm after 0.1 s, 0.100 mm after 0.19 s and 0.0977 mm from there on.
/// Positions in mm relative to the unpressurized rest length, extension positive.
///
/// Stepped exactly (matrix exponential for a reference that is linear in the step) unless the acceleration is
/// at its limit; a step with the limit active has constant acceleration. Once at rest on the target the servo
/// is snapped to it (within 1e-7 mm) and costs nothing.
class Crosshead {
 public:
  Crosshead(const FrameParameters& parameters, double dt_s) noexcept;

  /// Ramp from the present reference to `target_mm` at `speed_mm_s` > 0.
  void move(double target_mm, double speed_mm_s) noexcept;
  /// Stops the reference where it is; the servo settles there.
  void stop() noexcept;
  /// Power off: the brake decelerates, then the crosshead stands. Until release().
  void brake() noexcept { braking_ = true; }
  void release() noexcept;

  void step() noexcept {
    if (resting_) [[likely]] {
      return;
    }
    step_moving();
  }

  [[nodiscard]] double position_mm() const noexcept { return position_mm_; }
  [[nodiscard]] double velocity_mm_s() const noexcept { return velocity_mm_s_; }
  [[nodiscard]] bool braking() const noexcept { return braking_; }
  [[nodiscard]] bool reference_at_target() const noexcept { return reference_mm_ == target_mm_; }
  [[nodiscard]] bool resting() const noexcept { return resting_; }
  [[nodiscard]] double target_mm() const noexcept { return target_mm_; }

 private:
  void step_moving() noexcept;

  double dt_s_;
  double wn2_, a_, b_;
  double acceleration_max_, brake_mm_s2_;
  // e = x - r (mm) and u = x' - r' (mm/s) obey a homogeneous equation plus a constant drive r' (b - a) in a
  // step.
  double phi11_, phi12_, phi21_, phi22_;

  double position_mm_ = 0.0;
  double velocity_mm_s_ = 0.0;
  double reference_mm_ = 0.0;
  double target_mm_ = 0.0;
  double speed_mm_s_ = 0.0;
  bool resting_ = true;
  bool braking_ = false;
};

}  // namespace isorig::sim
