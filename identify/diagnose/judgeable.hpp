#pragma once
#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// Why a model that no evidence speaks against may still not be called consistent; nothing where it may. Checked in
/// this order:
///
/// - Too little excitation: the force varies by less than three noises rms. Any model would do.
/// - The nominal model explains nothing: its residual has more than a tenth of the force's variance. Where noise was
///   not measured such a residual may be taken for noise, and no force channel has that much.
/// - Readings that were left out of the fit are predicted three times worse than what was fitted: the recordings do not
///   determine the model, and it is consistent with them because it could be.
/// - The noise could not be measured, by rests, repetitions or strokes, and the residual has more than twice the
///   power of the guess by second differences (noise/noise.hpp): without a measured noise nothing tells whether that
///   residual is noise or missing physics.
[[nodiscard]] std::optional<Unjudged> unjudged(const Study& study, double nominal_rmse_N);

/// The noise that what the chosen model leaves is likeliest to be: from the fit's own estimate along the ridge of
/// amplitude and correlation (fit/noise_search.hpp), on which that estimate may stand far away.
[[nodiscard]] NoiseModel likeliest_noise(const Study& study);

/// Why what the chosen model leaves, which looks like the noise `left`, need not be physics: the rests, from which the
/// noise was measured, are too few to rule such a noise out (`rests_on`). Nothing where they do rule it out.
[[nodiscard]] std::optional<Unjudged> noise_beyond_the_rests(const Study& study, const NoiseModel& left);

}  // namespace isorig::identify
