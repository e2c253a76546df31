#pragma once
#include <cmath>
#include <numbers>

namespace isorig::model {

/// Volume of a braided chamber as a function of its length, for inextensible threads of length b that wind
/// n times round a cylinder (Chou and Hannaford 1996, eqs. 1-3):
///
///   D(L) = sqrt(b^2 - L^2) / (n pi),   V(L) = L (b^2 - L^2) / (4 pi n^2),   dV/dL = (b^2 - 3 L^2) / (4 pi
///   n^2)
///
/// Valid for 0 < L < b. Wall thickness and the cones at the end caps are neglected: V is the volume inside
/// the mesh, an upper bound of the air's. At the largest volume the thread is at the neutral angle,
/// acos(1 / sqrt(3)) = 54.7 degrees from the axis, where pressure neither shortens nor lengthens the muscle.
class Braid {
 public:
  Braid() = default;
  /// From the mesh diameter and the angle between thread and axis, both at the length `length_mm`.
  Braid(double length_mm, double diameter_mm, double angle_deg) noexcept {
    const double angle_rad = angle_deg * std::numbers::pi / 180.0;
    const double thread_mm = length_mm / std::cos(angle_rad);
    const double turns = thread_mm * std::sin(angle_rad) / (std::numbers::pi * diameter_mm);
    thread2_mm2_ = thread_mm * thread_mm;
    scale_ = 1.0 / (4.0 * std::numbers::pi * turns * turns);
  }
  [[nodiscard]] double volume_mm3(double length_mm) const noexcept {
    return length_mm * (thread2_mm2_ - length_mm * length_mm) * scale_;
  }
  /// Negative below the neutral angle (54.7 degrees from the axis): the chamber loses volume when it is stretched.
  [[nodiscard]] double slope_mm2(double length_mm) const noexcept {
    return (thread2_mm2_ - 3.0 * length_mm * length_mm) * scale_;
  }
  [[nodiscard]] double thread_mm() const noexcept { return std::sqrt(thread2_mm2_); }

 private:
  double thread2_mm2_ = 0.0;
  double scale_ = 0.0;
};

}  // namespace isorig::model
