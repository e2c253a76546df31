#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/search/hypothesis.hpp"

namespace isorig::identify {

/// The size from which these recordings can show an effect. It depends on protocol and noise alone, not on which
/// effects are there.
struct Discernible {
  const model::Physics* effect = nullptr;
  const model::Law* law = nullptr;          ///< the law, of those that the effect has, that shows best
  double seen_from_N = 0.0;                 ///< size from which the effect can be told from the nominal model
  const model::Physics* nearest = nullptr;  ///< the effect that comes nearest to it; null where it has no rival
  double told_from_N = 0.0;                 ///< size from which it can be told from that one; infinite: at no size
};

/// For every effect that may be tried beside the fitted nominal model `base`. With W the whitening of the noise, T the
/// derivatives of the nominal force by its own numbers, and s what a law at the starts of its sheet adds to the force,
/// scaled to a 99th percentile of 1 N over the bins,
///
///     P_T   projection off the span of W T             what the nominal model could take up by other numbers is gone
///     seen from   z / |P_T W s|                        z = 4: one chance in 30 000
///     told from   z / min over rivals |P_R P_T W s|    R: all that the rival's law adds at any of its starts
///
/// Size is that of practical_significance.hpp. Linear in the size: exact for laws with a stiffness or a force, near the
/// starts for a time constant, a gap or an exponent. Starts at which a law acts in less than a hundredth of the bins
/// are passed over. A rival that takes the place of nearly all (|P_R P_T W s| below 1e-6 of |W s|) can be told at no
/// size.
[[nodiscard]] std::vector<Discernible> discernible(const Search& search, const Hypothesis& base, unsigned threads);

}  // namespace isorig::identify
