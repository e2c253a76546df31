#pragma once
#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {

/// What keeps a model that nothing speaks against from being called consistent; nothing for one that may be. In this
/// order:
///
/// - Too little excitation: the force varies by less than three noises rms. Any model would do.
/// - The nominal model explains nothing: it leaves more than a tenth of the force's variance. What it leaves may pass
///   for noise where noise was not measured, and is no noise of a force channel.
/// - The noise could not be measured, by rests, repetitions or strokes, and the residual has more than twice the
///   power of the guess by second differences (noise/noise.hpp): it is noise, or it is not.
[[nodiscard]] std::optional<Unjudged> unjudged(const Study& study, double nominal_rmse_N);

}  // namespace isorig::identify
