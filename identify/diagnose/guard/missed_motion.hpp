#pragma once
#include <vector>

#include "messages/recording.hpp"

namespace isorig::identify {

/// Times at which readings come again after a gap in which the specimen could have moved by more than a fiftieth of the
/// recording's stroke, at the fastest velocity of the recording. Where it was meanwhile nobody knows, and its arms
/// begin in a state that is not known, as after the filling. The longest twelve, in the order of time; what a gap is
/// says gaps.hpp.
[[nodiscard]] std::vector<double> missed_motion(const messages::FrameSamples& frame);

}  // namespace isorig::identify
