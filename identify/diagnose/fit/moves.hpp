#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// A position that stays within this, so many times its noise, stands still.
[[nodiscard]] inline double still_mm(const Series& series) {
  return deciding().still_noises * series.excitation.motion.noise_mm;
}

/// A move begins where a rest ends: the velocity changes at this bin and had not changed for longer than a rest.
[[nodiscard]] inline bool begins_move(const Series& series, std::size_t bin) {
  return bin > 0 && series.since_corner_s[bin] == 0.0 && series.since_corner_s[bin - 1] > series.rest_s;
}

/// The recordings cut into moves. A move is a ramp, its hold and its return, with the rest after it: the unit that is
/// left out of a fit, drawn by a bootstrap, or taken as independent of the others. Every recording begins a new one.
struct MoveNumbers {
  std::vector<std::size_t> of_bin;  ///< bins of all series in a row; never decreasing
  std::size_t count = 0;
};
[[nodiscard]] MoveNumbers number_moves(std::span<const Series> series);

}  // namespace isorig::identify
