#pragma once
#include <string>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::identify {

/// A time of frame.csv in which pressure.csv has no reading.
struct UnreadPressure {
  double from_s = 0.0, to_s = 0.0;
};

/// Longer than eight times the spacing that a gauge has at most as a rule (its 99th percentile), and than 1 s; before
/// the gauge's first reading and behind its last one as well; without the second next to a reading. Nothing of a
/// recording without pressure.csv.
[[nodiscard]] std::vector<UnreadPressure> unread_pressure(const messages::Recording& recording);

/// "12 to 40 s and 100 to 102 s".
[[nodiscard]] std::string in_words(const std::vector<UnreadPressure>& unread);

}  // namespace isorig::identify
