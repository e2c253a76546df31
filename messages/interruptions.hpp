#pragma once
#include <vector>

#include "messages/recording.hpp"

namespace isorig::messages {

/// When the crosshead was stopped on its way and sent on again, by the events of an exported recording: `pause` and
/// `resume`, in s on the recording's clock. Empty where recording.toml has none, or what it has cannot be read.
[[nodiscard]] std::vector<double> interruptions_s(const RecordingMetadata& metadata);

}  // namespace isorig::messages
