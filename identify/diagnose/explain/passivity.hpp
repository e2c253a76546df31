#pragma once
#include <optional>
#include <span>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// A closed loop of the motion on which a model gives out more work than it took in.
struct ActiveLoop {
  double centre_mm = 0.0;
  double amplitude_mm = 0.0;
  double fastest_mm_s = 0.0;
  double work_N_mm = 0.0;  ///< taken in over a turn: negative
};

/// Looks for one. A passive specimen gives back no more than is stored in it (Willems 1972), so that in each turn
/// of a periodic motion, after the transients of its arms have decayed, it absorbs work:
///
///     integral of F dx over a turn >= 0
///
/// Sinusoidal loops over the whole, half and a quarter of the range of the recordings, at their fastest velocity, a
/// tenth and a hundredth of it; the sixth turn from standstill, 400 steps a turn, by the trapezoidal rule. F is of the
/// specimen and the rig with the pressure at its nominal value. Left out are the position's own errors (the loop is
/// what the specimen sees), the sensor (a late reading of a passive force is no work), and laws that count time or
/// travel (model::Counts). A force of 0.3 noises over the path, and a thousandth of the work that passes to and fro,
/// are not told from zero.
///
/// The first loop that is active; nothing for a passive model, and where nothing moves.
[[nodiscard]] std::optional<ActiveLoop> active_loop(const model::ModelSpec& spec, std::span<const Series> series,
                                                    double noise_N);

}  // namespace isorig::identify
