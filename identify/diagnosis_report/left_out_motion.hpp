#pragma once
#include <string>
#include <utility>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/report/figure.hpp"

/// Motions that the fits had not seen, beside what they predicted, for figures.
namespace isorig::identify {

/// Readings of a stretch that was left out, those that may be believed, with the forces that the two models say that
/// were learnt without it, and the band of the second.
struct PredictedStretch {
  std::vector<double> t_s, force_N, nominal_N, model_N, low95_N, high95_N;

  /// The share of the readings that lie in the band; NaN without readings.
  [[nodiscard]] double inside() const;
  [[nodiscard]] PredictedStretch between(double from_s, double to_s) const;
};

/// Where to look closely: the shortest time that holds 80 % of what both predictions err by beyond two noises, with as
/// much again to either side; all of the stretch where nothing is beyond.
[[nodiscard]] std::pair<double, double> worst_part(const PredictedStretch& stretch, double noise_N);

/// As `isorig predict` does it (forecast.hpp), with models that know nothing of the stretch.
[[nodiscard]] PredictedStretch predicted(const Study& study, const LeftOutStretch& stretch);

/// Measured force over both predictions, and measured minus predicted under it. At most `stretches` points a curve,
/// whatever the length of what was left out: the measured force as a band from lowest to highest with its mean, the
/// predictions as means, the band from its lowest to its highest edge.
[[nodiscard]] report::Figure left_out_motion(const Study& study, const LeftOutStretch& stretch,
                                             std::size_t stretches = 300);

/// "moves", "strokes", ...: what HeldoutStudy::blocks are called.
[[nodiscard]] std::string blocks_text(BlockKind kind);

}  // namespace isorig::identify
