#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "fault_matrix_rig.hpp"

/// Bounds of docs/faults.md that hold for every cell, whatever it ends as.
namespace isorig::daemon::test {

/// Where the protocol moves the crosshead from there on.
inline std::pair<double, double> reach_mm(At at) {
  switch (at) {
    case At::kJog:
    case At::kApproach:
      return {0.0, 3.0};
    case At::kSlow:
      return {-0.15, 0.15};
    case At::kFast:
    case At::kTriangle:
    case At::kSine:
      return {-2.0, 2.0};
    default:
      return {1.0, -1.0};  // it stands
  }
}

/// The plant's force, pressure and travel. `stands_s`: what the crosshead may take to stand.
inline void judge_limits(At at, const MatrixRig& rig, const Seen& seen, double stands_s) {
  constexpr double kOverSetpoint_psi = 3.0;
  constexpr double kOverLimit_psi = 1.5;
  constexpr double kForceShare = 0.05;  // of the range between the limits
  constexpr double kStill_mm = 0.02;
  const auto& limits = rig.config().limits;
  const double force_margin_N = kForceShare * (limits.force_max_N - limits.force_min_N);
  EXPECT_LE(seen.force_max_N, limits.force_max_N + force_margin_N);
  EXPECT_GE(seen.force_min_N, limits.force_min_N - force_margin_N);
  EXPECT_LE(seen.over_setpoint_psi, kOverSetpoint_psi);
  EXPECT_LE(seen.pressure_max_psi, limits.pressure_max_psi + kOverLimit_psi);
  auto [low_mm, high_mm] = reach_mm(at);
  double over_mm = kStill_mm;
  if (low_mm > high_mm) {
    low_mm = high_mm = seen.began_mm;
  } else {
    const double v = situation(at).speed_mm_s;
    const auto& s = rig.config().core.supervisor;
    over_mm =
        std::min(s.following_error_max_mm + 0.05 * v, s.following_error_min_mm + 0.25 * v) + v * stands_s + kStill_mm;
  }
  EXPECT_LE(seen.position_max_mm, high_mm + over_mm);
  EXPECT_GE(seen.position_min_mm, low_mm - over_mm);
}

}  // namespace isorig::daemon::test
