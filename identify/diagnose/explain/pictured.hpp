#pragma once
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/fit/left_out.hpp"

namespace isorig::identify {

/// A block by itself: predicted by models that were fitted without it and without the rest of its fold.
struct BlockError {
  std::size_t series = 0;
  std::string recording;  ///< the series' name
  double t_start_s = 0.0, t_end_s = 0.0;
  double readings = 0.0;
  double nominal_rmse_N = 0.0;
  double model_rmse_N = 0.0;
};

/// A stretch of one recording that was left out, with the two models that were learnt without it: to be drawn.
struct LeftOutStretch {
  std::string by, value;  ///< as of LeftOut; "block" of a block
  bool worst = false;     ///< by the larger rms of the two models; else the median
  std::size_t of = 0;     ///< how many blocks, or kinds, it was chosen from
  std::size_t series = 0;
  std::size_t first_bin = 0, end_bin = 0;           ///< of the series; one past the last
  double nominal_rmse_N = 0.0, model_rmse_N = 0.0;  ///< over all of the block or kind
  std::vector<bool> out;                            ///< all bins that were left out together with it
  model::ModelSpec nominal, model;                  ///< as learnt from the other bins
  /// For the band of a prediction: the rms of the blocks outside of `out`, each left out of its own fit, and no less
  /// than that of the readings that this fit has seen. What was measured in `out` is in neither error.
  double nominal_error_N = 0.0, model_error_N = 0.0;
};

/// What was left out together, as both models predict it.
struct LeftOutKind {
  std::string by, value;
  const std::vector<bool>& out;
  const Prediction& nominal;
  const Prediction& model;
};

/// Blocks in the order of time; those without readings are left out.
[[nodiscard]] std::vector<BlockError> block_errors(std::span<const Series> series, const Blocks& blocks,
                                                   std::span<const Prediction> nominal,
                                                   std::span<const Prediction> model, double white_N);

/// The worst and the median of the blocks, then of the kinds, by the rms of whichever model errs more: where the
/// nominal model fails is seen, and where the other does. Of a kind that lies in several places the one with the
/// largest sum of squares.
[[nodiscard]] std::vector<LeftOutStretch> stretches_to_draw(std::span<const Series> series, const Blocks& blocks,
                                                            std::span<const Prediction> nominal,
                                                            std::span<const Prediction> model,
                                                            std::span<const LeftOutKind> kinds, double white_N);

}  // namespace isorig::identify
