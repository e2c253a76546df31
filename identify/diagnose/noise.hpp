#pragma once
#include <span>

#include "identify/diagnose/fit.hpp"

namespace isorig::identify {

/// The force channel's own noise, white and coloured, from the rests of the recordings alone (no motion for
/// more than 10 s; a line and two decays are taken out of each: what relaxation leaves by then). No model
/// is involved, so what a model lacks cannot hide in it. Falls back to second differences, white only, when
/// there are not enough rests; `from_rests` says which.
struct InstrumentNoise {
  NoiseModel noise;
  bool from_rests = false;
};
[[nodiscard]] InstrumentNoise instrument_noise(std::span<const Series> series,
                                               std::span<const std::vector<bool>> usable);

}  // namespace isorig::identify
