#pragma once
#include <span>

#include "identify/diagnose/motion/reconstruction.hpp"

namespace isorig::identify {

/// The motion anew where it bends for long (a sine, a set-point that wanders). Of strokes and holds the readings demand
/// few straight lines; of a bend such lines make a polygon, which leaves the bend by several times what the lines'
/// variance says. There the acceleration is a random walk (white jerk) whose strength the readings choose by
/// likelihood. A stretch of the polygon is taken for a bend where the random walk, which has one number, makes its
/// readings likelier than the polygon, which has one for every turn. After smooth_motion(), whose motion it changes.
void smooth_curves(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion);

}  // namespace isorig::identify
