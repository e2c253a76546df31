#pragma once
#include "model/process.hpp"

namespace isorig::model::effect {

/// The presliding distance means the same in every law with a Dahl bristle or a Jenkins element.
inline constexpr NumberSheet kPreslidingSheet{
    .what = "Distance over which friction turns round after a reversal of the motion.",
    .unit = "mm",
    .range =
        "Instrument: at 0.2 um a good frame's position noise hides it. Physics: at 1 mm, a tenth of the rig's travel, "
        "the bristle is a spring.",
    .errors =
        "Noise of the position makes reversals that were not there and shortens it; if all reversals are larger than "
        "it, it "
        "is undetermined. Mistaken for play."};

}  // namespace isorig::model::effect
