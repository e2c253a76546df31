#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"

namespace isorig::identify {

/// Readings that jump away from their neighbours and back, alone or up to three together: at least eight noises off the
/// straight line through the readings on either side, which lie four times nearer to that line themselves (at a corner
/// of the motion they do not). Rows that `usable` leaves out are skipped; rows that are found are taken out of
/// `usable`.
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
  ChannelQuality quality;  ///< of `reading_mm`
};
[[nodiscard]] Despiked without_spikes(std::span<const double> t_s, std::span<const double> reading_mm,
                                      const ChannelQuality& quality);

}  // namespace isorig::identify
