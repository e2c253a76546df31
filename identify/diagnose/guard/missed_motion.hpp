#pragma once
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// Times at which readings come again after a gap in which the specimen could have moved by more than a fiftieth of the
/// recording's stroke, at the fastest velocity of the recording. Its position during the gap is unknown, and therefore
/// the state of its arms at the end of the gap, as after the filling. The longest twelve, in the order of time;
/// gaps.hpp defines a gap. `position_quality` is how well the position was read.
[[nodiscard]] std::vector<double> missed_motion(const messages::FrameSamples& frame,
                                                const ChannelQuality& position_quality);

}  // namespace isorig::identify
