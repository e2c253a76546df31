#pragma once
#include <optional>
#include <span>
#include <vector>

#include "identify/diagnose/motion/reconstruction.hpp"

namespace isorig::identify {

/// Mean over `width` rows (odd), three times over: nearly Gaussian, no phase. Linear laws hold between a
/// motion and a force that went through the same filter, whatever it took away. Near the ends the windows
/// shrink.
[[nodiscard]] std::vector<double> band_limited(std::span<const double> values, std::size_t width);

/// For a motion that never runs straight nor rests (a servo axis, a pendulum): velocity and acceleration from
/// the band-limited reading, as in the identification of robots (Janot, Gautier & Brunot 2019). The smallest
/// width whose acceleration holds less than `kMostNoise` of noise in power, since noise in a regressor pulls
/// its coefficient (a mass) towards zero by that share. Nothing when the rows are not evenly spaced or no
/// width does.
struct BandLimitedMotion {
  Motion motion;
  std::size_t width = 1;
};
[[nodiscard]] std::optional<BandLimitedMotion> band_limited_motion(std::span<const double> t_s,
                                                                   std::span<const double> reading_mm,
                                                                   const ChannelQuality& quality);

}  // namespace isorig::identify
