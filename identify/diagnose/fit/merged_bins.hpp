#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// The same recordings in bins of up to `together` of theirs, none across a corner of the motion or a jump of the
/// force: for what is compared and then fitted again in the bins themselves. A merged bin stands at the mean of its
/// readings, as every bin does; one without readings at its last bin. What a fit does not read (recording, quality,
/// readings by row) is left empty.
[[nodiscard]] std::vector<Series> merged_bins(std::span<const Series> series, std::size_t together);

}  // namespace isorig::identify
