#pragma once
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/search/hypothesis.hpp"

namespace isorig::identify {

/// Everything that was tried, weighed.
struct Selection {
  std::vector<Hypothesis> pool;  ///< one per set of effects; pool[0] is the nominal model
  std::vector<double> weight;    ///< posterior weight of each, sums to 1
  std::vector<double> weighed;   ///< ... before any was discounted; sets that a discount made have none
  std::size_t best = 0;
  double noise_scale = 1.0;                             ///< whitened variance where nothing is left to explain
  std::vector<double> excess;                           ///< per hypothesis: sum of squares beyond the noise
  std::map<const model::Physics*, double> probability;  ///< of each effect being there
  /// There were no rests to measure the noise in, and the best explanation leaves more than three noises rms: that
  /// residual is the laws' own error. Explanations are then compared by the variance they leave, not by likelihood.
  bool error_rules = false;

  std::map<const model::Physics*, double> size_N;  ///< of each effect of the chosen (practical_significance.hpp)

  [[nodiscard]] const Hypothesis& nominal() const { return pool.front(); }
  [[nodiscard]] const Hypothesis& chosen() const { return pool[best]; }
};

/// At what the table of deciding numbers has (deciding/numbers.inc).
struct SelectionOptions {
  std::size_t most_effects = deciding().most_effects;
  /// What an effect must gain in log evidence to be looked at further.
  double least_gain = deciding().least_gain_nats;
  /// Prior log odds against each effect: most rigs lack none of a given one.
  double prior_cost = deciding().prior_cost_nats;
  /// Further against effects beyond the recording format's list (PhysicsTraits::unusual).
  double unusual_cost = deciding().unusual_cost_nats;
  /// Further against effects that contain another as a special case (PhysicsTraits::contains): half the log of some
  /// thousands of rows, what the information criterion asks for a number.
  double contains_cost = deciding().containing_cost_nats;
  /// Against physics that the catalogue lacks, beyond what its table costs in degrees of freedom.
  double unknown_cost = deciding().unknown_cost_nats;
  /// Degrees of freedom of the model error in a recording. When the best explanation leaves more than noise,
  /// likelihoods overstate, because they count every bin as independent: two explanations are then compared by their
  /// residual variances with this many degrees of freedom.
  double error_degrees = deciding().error_degrees;
  /// Take the degrees of freedom that the residual of the best explanation shows, where they are more
  /// (effective_dof.hpp).
  bool count_independent_errors = false;
  /// The instrument's noise as measured in rests can be wrong by this much in power, not more; where there
  /// were no rests it is a guess, and the quietest half of the recording says.
  double least_noise_scale = 0.0;
  double most_noise_scale = std::numeric_limits<double>::infinity();
  /// rms noise of one reading. What the search weighs by is more where bins of many readings share a slow noise.
  double reading_noise_N = std::numeric_limits<double>::infinity();
  /// What a model errs by that lacks nothing worth a name: in noises of a reading, and as a share of the
  /// largest effect in it (practical_significance.hpp).
  double model_error_noises = deciding().model_error_noises;
  double model_error_share = deciding().model_error_share;
  /// Called as the selection goes on, with the part of its usual time that has gone.
  std::function<void(double fraction)> on_progress{};
};

/// Singles, pairs, threes by beam; every set refitted as a whole; sets that do not need all their members
/// lose them again.
[[nodiscard]] Selection select_effects(const Search& search, const model::ModelSpec& nominal,
                                       const SelectionOptions& options);

/// Weighs the pool anew (after hypotheses were added). With, for explanation i,
///
///     L_i   log evidence: log-likelihood - k_i/2 ln(rows), k_i its free numbers (Schwarz 1978)
///     Q_i   squares it leaves, in units of the instrument's noise; n rows; s the scale of that noise
///     c_i   what its effects cost a priori
///     X     excess of the best: max(Q_best - s n, 0) / s, and a floor of 40 squares that chance may leave
///     d     degrees of freedom of the model error
///
/// the log weight is
///
///     -min( L_best - L_i,  d/2 ln(1 + (Q_i - Q_best) / s / X) ) - c_i
///
/// The first term is the Bayes factor by the information criterion. The second is the likelihood ratio of two
/// variances with d degrees of freedom: where even the best leaves much, a difference in what is left says no more
/// than that. The milder of the two counts.
void weigh(Selection& selection, const Search& search, const SelectionOptions& options);

}  // namespace isorig::identify
