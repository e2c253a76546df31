#pragma once
#include <optional>
#include <span>
#include <vector>

#include "identify/diagnose/noise/noise_likelihood.hpp"

namespace isorig::identify {

/// The difference between a stroke and an earlier one in the same direction, at equal positions and nearly equal
/// velocities: force that repeats cancels, whatever its law, and twice the variance of the noise remains (pure error by
/// near replicates, Daniel & Wood 1971). Divided by the root of two, it is a sample of the noise. Level and slope (a
/// drift, a softening) and what is linear in the differences of velocity, acceleration and pressure are the columns
/// that are taken out. The first tenth of a stroke is left out: its force depends on where the stroke before ended.
[[nodiscard]] std::vector<NoiseSample> repetitions(const Series& series);

/// Strokes from one turning point to the next.
[[nodiscard]] std::size_t stroke_count(const Series& series);

/// Noise by the repetitions of all recordings; nothing when fewer than 200 readings of 4 strokes repeat.
/// Coloured noise slower than a quarter of a stroke passes for its level and slope, and is not seen.
[[nodiscard]] std::optional<NoiseModel> noise_of_repetitions(std::span<const Series> series, double start_N);

/// White noise that gives the bins, on average, the variance that `noise` gives them. Without rests, residuals are
/// weighed by this instead of the coloured noise itself: whitening weakens slow parts of a residual and keeps fast
/// ones, and the fastest part of a model's error is at the turning points, where laws of friction are least accurate.
/// The turning points would then decide the fitted numbers.
[[nodiscard]] NoiseModel noise_of_bins(std::span<const Series> series, const NoiseModel& noise);

/// A motion that never rests and never comes back (a pendulum that swings out): every stroke, cut into pieces
/// of 24 bins, is smooth but for the noise, and the turning points, where friction is not, are left out. A
/// polynomial of degree five is taken out of each piece: over half a swing it leaves 0.1 % of a sine. What a
/// piece shows is the noise of bins after the filter they went through (band_limited_motion.hpp), which second
/// differences of the readings cannot know when the noise is correlated (Hall & Van Keilegom 2003). Structure
/// slower than a piece is not noise and is not counted.
[[nodiscard]] std::optional<NoiseModel> noise_within_strokes(std::span<const Series> series, double start_N);

}  // namespace isorig::identify
