#pragma once
#include <span>
#include <string>
#include <string_view>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

enum class NoiseSource { kRests, kRepetitions, kStrokes, kDifferences };
[[nodiscard]] std::string_view name_of(NoiseSource source) noexcept;

/// The force channel's own noise, white and coloured. No model is involved, so that missing physics cannot be counted
/// as noise. Measured in the rests of the recordings (no motion for more than 10 s; a line and two decays are taken out
/// of each, for the relaxation that still goes on); without rests by the differences between strokes that repeat, or by
/// the deviation of a stroke from a smooth curve (repetitions.hpp); without any of these by second differences, white
/// only, which is a guess.
struct InstrumentNoise {
  NoiseModel noise;
  NoiseModel weighing;  ///< what residuals are weighed by: the same from rests, else white (noise_of_bins)
  NoiseSource source = NoiseSource::kDifferences;
  /// Above 0 the coloured part forgets by readings and not by time, as behind a filter that takes one step for each
  /// reading of a logger whose intervals vary: the rests are likelier so. Each reading counts for the median interval.
  double reading_s = 0.0;

  [[nodiscard]] bool measured() const noexcept { return source != NoiseSource::kDifferences; }
};
[[nodiscard]] InstrumentNoise instrument_noise(std::span<const Series> series,
                                               std::span<const std::vector<bool>> usable);

/// "0.4 s", or "8 readings" where a noise forgets by readings (InstrumentNoise::reading_s).
[[nodiscard]] std::string correlation_words(double correlation_s, double reading_s);

/// What the rests say of a noise that was found in motion.
struct RestsOnNoise {
  std::size_t readings = 0;  ///< of the rests, once the relaxation has settled
  bool allow = false;        ///< too few to rule the noise out
};
/// `allow`: the readings of the rests are less likely under `noise` than under the noise that suits them best by no
/// more than chance (`allowed_noise_log`; Wilks 1938). Never where the noise is correlated over longer than a rest can
/// tell from its own relaxation.
[[nodiscard]] RestsOnNoise rests_on(const NoiseModel& noise, std::span<const Series> series,
                                    std::span<const std::vector<bool>> usable);

}  // namespace isorig::identify
