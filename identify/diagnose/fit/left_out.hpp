#pragma once
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "identify/diagnose/fit/blocks.hpp"
#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// The state of an arm at the start or after a gap, a drift that wanders without law, or an event: no other part of the
/// data determines it. If the readings that show it are left out, a fit to the others gives it an arbitrary value.
/// Learners therefore keep it fixed, and predictions take it from all readings.
[[nodiscard]] bool is_state(const model::Part& part);

/// Learns a model from what is kept of the recordings, by the criterion that it was published under. Bins that are left
/// out have no readings (count 0): the motion passes there and the force is not looked at. A model that says what it
/// has seen of them fades beyond (fading.hpp), as its predictions will.
using Learner = std::function<model::ModelSpec(std::span<const Series> kept)>;

/// Under one noise, from the spec's own numbers, until it has converged or `iterations` have passed.
[[nodiscard]] Learner refit(const model::ModelSpec& spec, const NoiseModel& noise, int iterations = 15);

/// The same recordings; bins marked in `out` have no readings. All series in a row.
[[nodiscard]] std::vector<Series> without(std::span<const Series> series, const std::vector<bool>& out);

/// A bin that was left out and has readings.
struct LeftOutBin {
  double readings = 0.0;
  double error_N = 0.0;  ///< measured minus predicted
  std::size_t stroke = 0;
};

/// The error of a model in bins that it was not fitted to.
struct Prediction {
  model::ModelSpec spec;    ///< as learnt without them
  double squares_N2 = 0.0;  ///< measured minus predicted, squared, summed over the readings left out
  double readings = 0.0;
  double bins = 0.0;                      ///< left out, with readings in them
  std::vector<double> squares_of_stroke;  ///< the same squares by stroke, for those that are left out
  std::vector<LeftOutBin> each_bin;       ///< in the order of time

  /// rms of a single reading. The mean of n readings carries 1/n of their white variance, so that the squares of B
  /// bins of R readings lack white^2 (R - B): it is added back. 0 when nothing was left out.
  [[nodiscard]] double rmse_N(double white_N) const;
};

/// Leaves out the bins marked in `out` (all series in a row), learns the model from the others and predicts them.
/// `strokes` numbers the bins for `squares_of_stroke`.
[[nodiscard]] Prediction predict_left_out(std::span<const Series> series, const Learner& learner,
                                          const std::vector<bool>& out, const Blocks& strokes);

/// What `share` of the model and the rest of the nominal model predict together, of the same bins: the errors add up as
/// the forces do.
[[nodiscard]] Prediction mixed(const Prediction& nominal, const Prediction& model, double share);

/// The squares, summed over the readings marked in `out`, by which a prediction is expected to err merely because the
/// numbers of `learnt` come from noisy readings, those that are kept:
///
///     E sum_i n_i (F_i(learnt) - F_i(true numbers))^2 = sum_i n_i (J C J')_ii
///
/// with n_i the readings of a bin, J the change of its force by the fitted numbers and C their covariance under `noise`
/// (fit/intervals.hpp). To first order in the numbers.
[[nodiscard]] double learning_error_N2(std::span<const Series> series, const model::ModelSpec& learnt,
                                       const NoiseModel& noise, const std::vector<bool>& out);

/// The bins that predict_blocks() leaves out together with this block, and itself.
[[nodiscard]] std::vector<bool> left_out_with(const Blocks& blocks, std::size_t block);

/// Every block predicted by a model learnt without the blocks of its fold: blocks are dealt into four folds in turn
/// (strokes two at a time), so that in a session of ten ramps each fold holds other velocities. One entry a block; none
/// where nothing can be left out.
[[nodiscard]] std::vector<Prediction> predict_blocks(std::span<const Series> series, const Learner& learner,
                                                     const Blocks& blocks, unsigned threads);

/// All of them together.
[[nodiscard]] Prediction together(std::span<const Prediction> blocks);

}  // namespace isorig::identify
