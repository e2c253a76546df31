#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// One kind of motion left out of the fit and predicted.
struct LeftOut {
  std::string by;     ///< velocity, amplitude, waveform
  std::string value;  ///< "8 mm/s", "4 mm", "ramp"
  double readings = 0.0;
  double nominal_rmse_N = 0.0;
  double model_rmse_N = 0.0;
};

/// A number of the model over all these fits: what hangs on one motion is not a property of the specimen.
struct Stability {
  std::string parameter;  ///< "coulomb_friction.force_N"
  double value = 0.0;     ///< from everything
  double lowest = 0.0;
  double highest = 0.0;
};

struct HeldoutStudy {
  std::vector<LeftOut> left_out;
  std::vector<Stability> stability;
};

/// The recording's moves (from one rest to the next) by their largest velocity, by their range and by their
/// waveform; where there are several of a kind each is left out in turn, both models are refitted to the rest
/// and predict it. Empty where the motion never rests, or is all of one kind.
[[nodiscard]] HeldoutStudy study_heldout(const Problem& problem, const model::ModelSpec& nominal,
                                         const model::ModelSpec& model, unsigned threads);

}  // namespace isorig::identify
