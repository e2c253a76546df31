#pragma once
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// A model refitted without some bins, and what it is wrong by in them.
struct Prediction {
  model::ModelSpec spec;    ///< refitted
  double squares_N2 = 0.0;  ///< measured minus predicted, squared, summed over the readings left out
  double readings = 0.0;
  double bins = 0.0;  ///< left out, with readings in them

  /// rms of a single reading. The mean of n readings carries 1/n of their white variance, so that the squares of B
  /// bins of R readings lack white^2 (R - B): it is added back. 0 when nothing was left out.
  [[nodiscard]] double rmse_N(double white_N) const;
};

/// Leaves out the bins marked in `out` (all series in a row), refits `spec` from its numbers and predicts them.
[[nodiscard]] Prediction predict_left_out(const Problem& problem, const model::ModelSpec& spec,
                                          const std::vector<bool>& out, int iterations);

/// Every move predicted by a refit without the moves of its fold: moves are dealt into four folds in turn, so that in
/// a session of ten ramps each fold holds other velocities. One entry a move.
[[nodiscard]] std::vector<Prediction> predict_moves(const Problem& problem, const model::ModelSpec& spec,
                                                    unsigned threads);

/// All of them together: rms of a single reading.
[[nodiscard]] double left_out_rmse_N(const Problem& problem, const model::ModelSpec& spec, unsigned threads);

}  // namespace isorig::identify
