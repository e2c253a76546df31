#pragma once
#include "model/composed.hpp"
#include "model/elements.hpp"

namespace isorig::model {

/// Another recording has none of it: a shape over the whole of a recording (describes_recording), or a table or a wave
/// without a name in the time or the distance since somebody began to record, by which alone no specimen adds a force.
[[nodiscard]] inline bool of_one_recording(const Part& part) {
  const bool has_no_name = part.law->make_table != nullptr || part.physics == &element::empirical_memory();
  return describes_recording(*part.law) || (has_no_name && part.law->traits.counts != Counts::kNothing);
}

}  // namespace isorig::model
