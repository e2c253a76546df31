#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// How many readings each row of frame.csv stands for, relative to the noisiest kind of row. A recorder that
/// keeps means where nothing happens writes rows whose noise is ten times smaller than that of the rest; equal weights
/// would waste the precision of the means or give single readings too much. Estimated from the force's own noise for
/// each class of spacing; rows that were thinned out but not averaged count as one reading.
///
/// An amplifier that warms up may double its noise over a session. Weighed alike, the noisy half would look like a
/// model that fails there. Where the logarithm of the noise follows a straight line in time (six standard errors of its
/// slope, and a fifth from end to end), rows weigh as the inverse of their variance. A noise that is larger in motion
/// than at rest changes no weights: it may be stick-slip, which is force.
struct RowWeights {
  std::vector<double> per_row;    ///< readings that the row stands for
  std::vector<double> precision;  ///< those, over the variance of a reading at that time relative to noise_N^2
  double noise_N = 0.0;           ///< rms of a row that counts as one
};
[[nodiscard]] RowWeights row_weights(const messages::FrameSamples& frame, const ChannelQuality& force_quality);

}  // namespace isorig::identify
