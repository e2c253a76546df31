#pragma once
#include <span>
#include <vector>

#include "identify/fv/ramps.hpp"

/// Within this room alone: analyse_ramps (ramps.hpp) is what others call.
namespace isorig::identify {

/// A recording with the noise of its channels.
struct RampChannels {
  const messages::Recording& recording;
  std::span<const double> t_s;
  std::span<const double> x_mm;
  std::span<const double> force_N;
  double sigma_x_mm;
  double sigma_force_N;
  std::vector<char> clipped;  ///< per sample
};

/// The point that one motion puts on the curve. `hold_after`: the specimen stayed where the motion took it.
[[nodiscard]] Ramp measure_ramp(const RampChannels& c, const Move& m, const RampOptions& options, bool hold_after);

}  // namespace isorig::identify
