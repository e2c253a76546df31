#pragma once
#include <span>
#include <string_view>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

enum class NoiseSource { kRests, kRepetitions, kStrokes, kDifferences };
[[nodiscard]] std::string_view name_of(NoiseSource source) noexcept;

/// The force channel's own noise, white and coloured. No model is involved, so what a model lacks cannot
/// hide in it. From the rests of the recordings (no motion for more than 10 s; a line and two decays are
/// taken out of each: what relaxation leaves by then); without rests from how well strokes that repeat
/// repeat, or from how smooth a stroke is (repetitions.hpp); without any of these from second differences,
/// white only, which is a guess.
struct InstrumentNoise {
  NoiseModel noise;
  NoiseModel weighing;  ///< what residuals are weighed by: the same from rests, else white (noise_of_bins)
  NoiseSource source = NoiseSource::kDifferences;

  [[nodiscard]] bool measured() const noexcept { return source != NoiseSource::kDifferences; }
};
[[nodiscard]] InstrumentNoise instrument_noise(std::span<const Series> series,
                                               std::span<const std::vector<bool>> usable);

}  // namespace isorig::identify
