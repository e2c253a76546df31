#pragma once
#include <optional>

#include "identify/diagnose/guard/guard.hpp"

namespace isorig::identify {

/// A session of the rig begins with its own filling, and the recording with it: from no pressure to the
/// nominal one, a load that no nominal model describes. Cuts off the rows of both streams before the pressure
/// has first stayed near its nominal value for a second, and those after it was let go. Nothing is cut from a
/// recording that begins and ends under pressure, or that has none. Returns what was cut.
[[nodiscard]] std::optional<DataFault> cut_start_up(messages::Recording& recording);

}  // namespace isorig::identify
