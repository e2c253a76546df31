#pragma once
#include <span>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::identify {

/// How many readings each row of frame.csv stands for, relative to the noisiest kind of row. A recorder that
/// keeps means where nothing happens writes rows whose noise is ten times smaller than that of the rest; to
/// weigh them alike would throw away either the one or the other. Seen from the force's own noise, per class of
/// spacing; rows that were thinned out but not averaged count as one.
struct RowWeights {
  std::vector<double> per_row;
  double noise_N = 0.0;  ///< of a row that counts as one
};
[[nodiscard]] RowWeights row_weights(const messages::FrameSamples& frame);

}  // namespace isorig::identify
