#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "protocol/cursor.hpp"

namespace isorig::protocol::test {

/// The least rig that a cursor can drive: a frame that moves evenly and says when it is there, a pressure
/// that follows the set-point's slope, a force that relaxes after it has been moved (one standard linear
/// solid).
class Plant {
 public:
  static constexpr double kStiffness_N_mm = 5.0, kRelaxing_N_mm = 3.0, kTau_s = 2.0;

  explicit Plant(std::int64_t tick_ns) : tick_ns_(tick_ns), tick_s_(static_cast<double>(tick_ns) * 1e-9) {}

  [[nodiscard]] Observation see() const { return {position_mm, force_N(), pressure_psi, true, reached, segment.id}; }
  [[nodiscard]] double force_N() const {
    return 2.0 * pressure_psi + kStiffness_N_mm * position_mm + kRelaxing_N_mm * strain_mm;
  }

  /// What the daemon does with an action, then one tick of time.
  void step(const Action& action) {
    if (action.start_segment) {
      segment = action.segment;
      sent.push_back(action.segment);
      reached = false;
      frame_stopped = false;
    }
    const double moved_before_mm = position_mm;
    if (!reached && !frame_stopped && !frame_stuck && segment.id != 0) {
      const double left_mm = segment.target_mm - position_mm;
      const double stride_mm = segment.velocity_mm_s * tick_s_;
      if (std::abs(left_mm) <= stride_mm) {
        position_mm = segment.target_mm;
        reached = true;
      } else {
        position_mm += std::copysign(stride_mm, left_mm);
      }
    }
    travel_mm += std::abs(position_mm - moved_before_mm);
    strain_mm = (strain_mm + position_mm - moved_before_mm) * std::exp(-tick_s_ / kTau_s);
    if (!supply_empty) {
      const double stride_psi = action.rate_psi_s * tick_s_;
      pressure_psi += std::clamp(action.setpoint_psi - pressure_psi, -stride_psi, stride_psi);
    }
    now_ns += tick_ns_;
  }

  std::int64_t now_ns = 1'000'000'000;
  double position_mm = 0.0, pressure_psi = 0.0, strain_mm = 0.0, travel_mm = 0.0;
  MotionCommand segment;
  std::vector<MotionCommand> sent;
  bool reached = false, frame_stopped = false, frame_stuck = false, supply_empty = false;

 private:
  std::int64_t tick_ns_;
  double tick_s_;
};

}  // namespace isorig::protocol::test
