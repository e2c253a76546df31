#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// A stretch of a covariate or of time in which the nominal model misses.
struct Place {
  double t_start_s = 0.0;
  double t_end_s = 0.0;
  std::string covariate;
  double share = 0.0;
  double share_low = 0.0;
  double share_high = 0.0;
  std::string text;
  std::string recording;  ///< of a stretch of time; empty: all of them
  /// Where half of it stands, or in the stretch: measured minus simulated, without and with what lacked.
  double nominal_rmse_N = 0.0;
  double model_rmse_N = 0.0;
};

/// Where the nominal model misses: the variables that carry the excess, with their shares of the excess
/// residual power (95 %, bootstrap over moves) and where along them half of it stands; then stretches of time
/// (95 % of the noise's own scatter). Each with the error of both models there.
[[nodiscard]] std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal,
                                        const model::ModelSpec& model, double noise_scale);

}  // namespace isorig::identify
