#pragma once
#include <functional>
#include <span>
#include <vector>

#include "messages/recording.hpp"

/// Within this room alone: align (align.hpp) is what others call.
namespace isorig::identify {

/// At which lag the pressure responds to the strokes, on a grid of 0.1 s. All zero: no lag has enough strokes in
/// common.
struct CoarseAlignment {
  double score = 0.0;  ///< |p.s| / |s| at the best lag
  double lag_s = 0.0;  ///< frame grid start + lag is the pressure grid's start
  double skew = 0.0;
  double gamma_per_s = 1.0;
  double significance = 0.0;
  double second = 0.0;           ///< `score` more than a stroke's length away
  double explained_share = 0.0;  ///< of the pressure's squares about its moving mean
};

/// Every lag, a few recoveries, skews so close together that the strokes stay within half a second. `on_progress`,
/// where there is one, is told before each skew which part is done.
[[nodiscard]] CoarseAlignment find_coarse_alignment(const messages::FrameSamples& frame,
                                                    const messages::PressureSamples& pressure, double largest_skew,
                                                    const std::function<void(double)>& on_progress);

/// s(t) at the frame's own samples.
[[nodiscard]] std::vector<double> response_to_motion(const messages::FrameSamples& frame, double gamma_per_s);

/// Linear interpolation; `hint` walks forward with increasing t.
[[nodiscard]] double interpolate(std::span<const double> t, std::span<const double> y, double at, std::size_t& hint);

}  // namespace isorig::identify
