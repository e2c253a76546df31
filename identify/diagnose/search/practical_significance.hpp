#pragma once
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// The size of an effect: 99th percentile over the bins of the change in force when the effect is left out and
/// everything else is refitted.
[[nodiscard]] double size_N(const Search& search, const Hypothesis& with, const Hypothesis& without);

/// Statistical significance is not enough to name a second effect. The law found for the first is never exactly right:
/// its error is about a noise of a reading and 8 % of the largest effect. With 30 000 readings, the effect that fits
/// such an error best is statistically significant. An effect beside a larger one is therefore believed
///
///     with odds (size / e)^4,   e = hypot(noise, 0.08 m largest, alike)
///
/// m, the meeting_share of the effect's force and that of all effects, is asked of slips and drifts, and 1 for all
/// others. The error of a law that follows the motion stands where that law adds force, in every stroke: that of a
/// mass, which pulls at corners alone, is no slip. Of two effects that follow the motion, one may be the other's error
/// wherever both stand, since everything else is refitted around it.
///
/// and the rest of its weight goes to the explanation without it, which becomes the answer if it then has more weight.
/// `alike` is for an effect beyond the recording format's thirteen that depends on a single thing: the size of another
/// effect that depends on that thing alone, since of two functions of time one may be the error of the other's formula.
/// The smallest effect is judged first, then the others again. The noise is as measured, or the residual of the
/// explanation if that is smaller. The fourth power is fitted: it takes an effect of half the error's size to 6 % and
/// of twice its size to 94 %.
void discount_insignificant_effects(Selection& selection, const Search& search, const SelectionOptions& options);

/// How much of the force of all effects stands where one of them adds its own, c and a being both over the bins:
///
///     m^2 = (sum c^2 a^2 / sum c^2) / (sum a^4 / sum a^2),   at most 1
///
/// 1 where c is a share of a, or nothing; for a constant c, and an a that stands in a share f of the bins alone,
/// sqrt(f).
[[nodiscard]] double meeting_share(const Eigen::VectorXd& effect_N, const Eigen::VectorXd& all_N);

/// What an effect of `size_N` keeps of its weight beside the others of `chosen`, the largest of which has `largest_N`
/// (and one that it may be the error of, `alike_N`): the odds of above as a probability.
[[nodiscard]] double significance(const Search& search, const Hypothesis& chosen, const SelectionOptions& options,
                                  double size_N, double largest_N, double alike_N = 0.0);

}  // namespace isorig::identify
