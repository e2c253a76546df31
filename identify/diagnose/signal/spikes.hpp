#pragma once
#include <span>
#include <vector>

namespace isorig::identify {

/// RowWeights that jump away from their neighbours and back, alone or up to three together: at least eight
/// noises off the straight line of the readings on either side, who agree with each other four times better
/// (a corner of the motion bends them too). Rows already out of `usable` are not looked at; rows found leave
/// it.
struct Spikes {
  std::vector<std::size_t> rows;
  double largest = 0.0;
};
[[nodiscard]] Spikes find_spikes(std::span<const double> t_s, std::span<const double> reading, double noise,
                                 std::vector<bool>& usable);

/// A position without its spikes: straight across them. A laser that loses its target for one reading turns
/// the motion back by tenths of a millimetre, and friction with it.
struct Despiked {
  std::vector<double> reading_mm;
  Spikes spikes;
};
[[nodiscard]] Despiked without_spikes(std::span<const double> t_s, std::span<const double> reading_mm);

}  // namespace isorig::identify
