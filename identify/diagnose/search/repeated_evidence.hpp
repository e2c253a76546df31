#pragma once
#include <optional>

#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// The evidence for an effect by the agreement of the recording's strokes.
///
/// A likelihood takes its noise as given. Where the force wanders more slowly than a rest or a stroke lasts, or hums at
/// a frequency that the sampling folds down, the noise is underestimated, and the effect that follows such a wander
/// best looks significant. Its fitted size then differs from stroke to stroke by more than the noise allows. With r the
/// whitened residual of the explanation, c the change of its force when the effect is left out and everything else is
/// refitted, and sums over the bins of stroke b of B,
///
///     s   = 1 + c'r / c'c                       share of the effect that the readings want; 1 where the fit is done
///     u_b = c_b'r_b - (s - 1) c_b'c_b           what stroke b wants beyond that share, times c'c
///     t   = s c'c / sqrt(B/(B-1) sum_b u_b^2)   Liang & Zeger 1986, one number, clusters of one stroke
///
/// t has B - 1 degrees of freedom at most (Cameron & Miller 2015, VI.D). Returned is z, the deviate of the standard
/// normal distribution that is as improbable. It does not depend on the level of the noise, only on its colour. The
/// strokes are those of blocks.hpp; where moves (a ramp with its hold and return) disagree more, it is the moves that
/// count. Empty with fewer than eight of both: their disagreement says nothing then.
///
/// `noise` whitens the residuals: normally the noise model that `with` was fitted under, since its residual is then
/// closest to independent. Where plain least squares decide (published.hpp), the residual is mostly the law's own
/// error, largest at the turning points; whitening by that error would give nearly all weight to them. There the caller
/// passes the instrument's noise, taken as white.
[[nodiscard]] std::optional<double> agreement(const Search& search, const Hypothesis& with, const Hypothesis& without,
                                              const NoiseModel& noise);

/// Takes the weight of effects that strokes do not agree on to the explanations without them: no effect of the chosen
/// explanation keeps odds above
///
///     exp(z^2 / 2 - c) / n
///
/// exp(z^2 / 2) is the most that any prior on its size lets such a z say for it (Edwards, Lindman & Savage 1963), c its
/// prior cost, n the number of effects of the catalogue, since the best of n was taken. z = 4 leaves 86 %, z = 3 leaves
/// 15 %.
void discount_unrepeated_effects(Selection& selection, const Search& search, const SelectionOptions& options);

/// What an effect costs a priori, in log odds.
[[nodiscard]] double prior_cost(const model::Physics& effect, const SelectionOptions& options);

}  // namespace isorig::identify
