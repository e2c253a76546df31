#pragma once
#include <span>

#include "identify/diagnose/motion/reconstruction.hpp"

namespace isorig::identify {

/// Accelerations anew where the motion changes its velocity. Straight from reading to reading is right for
/// what slides and relaxes, but its acceleration is that of single readings, noise and all, which pulls a
/// mass towards zero. In a corner the acceleration is a random walk (white jerk) whose strength the corner's
/// readings choose themselves by likelihood, between the straight lines before and after it. Curves
/// (smooth_curves()) have theirs already.
void smooth_corners(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion);

}  // namespace isorig::identify
