#pragma once
#include "model/process.hpp"

namespace isorig::model {

/// Another recording has none of it: a shape over the whole of a recording (describes_recording), or a table of the
/// time or the distance since somebody began to record, by which alone no specimen adds a force.
[[nodiscard]] inline bool of_one_recording(const Law& law) {
  return describes_recording(law) || (law.make_table && law.traits.counts != Counts::kNothing);
}

}  // namespace isorig::model
