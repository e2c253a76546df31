#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"

namespace isorig::identify {

/// Rows first .. end - 1.
struct FlatRun {
  std::size_t first = 0;
  std::size_t end = 0;
};

/// Runs of one and the same value where the noise would have moved the reading: a dozen at least, and so long
/// that such a run comes by chance once in a thousand recordings. A reading in the middle of its step repeats
/// itself with the probability erf(step / (2 sqrt(2) noise)), which for a fine step is nil and for one of
/// three noises is 0.87.
[[nodiscard]] std::vector<FlatRun> flat_runs(std::span<const double> reading, const ChannelQuality& quality);

/// Takes them out of a position: straight from the last reading that was alive to the next. False where there are none.
bool bridge_flat_runs(std::span<const double> t_s, std::vector<double>& reading_mm, const ChannelQuality& quality);

}  // namespace isorig::identify
