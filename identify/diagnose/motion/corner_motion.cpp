#include "identify/diagnose/motion/corner_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "identify/diagnose/motion/white_jerk.hpp"

namespace isorig::identify {
namespace {

/// The line before or after a corner, certain to a position noise over the length of the corner, or hardly at all where
/// the motion already turns.
MotionEnd line(double velocity_mm_s, bool turns, double noise_mm, double span_s) {
  MotionEnd end;
  end.velocity_mm_s = velocity_mm_s;
  end.velocity_variance_mm2_s2 = (turns ? 1e6 : 1.0) * noise_mm * noise_mm / (span_s * span_s);
  end.acceleration_variance_mm2_s4 = turns ? 1e6 : 1.0;
  return end;
}

}  // namespace

void smooth_corners(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion) {
  const std::size_t n = t_s.size();
  constexpr double kMargin_s = 0.03, kApart_s = 0.05, kStill_mm_s = 1e-6;
  constexpr std::size_t kFewest = 6;
  if (n < kFewest) return;
  std::vector<bool> moves(n, false), near(n, false);
  const auto curves = [&](std::size_t k) { return !motion.curves.empty() && motion.curves[k]; };
  for (std::size_t k = 1; k + 1 < n; ++k) {
    moves[k] = !curves(k) && std::fabs(motion.acceleration_mm_s2[k]) * 0.5 * (t_s[k + 1] - t_s[k - 1]) > kStill_mm_s;
    if (!moves[k]) continue;
    for (std::size_t j = k; t_s[k] - t_s[j] <= kMargin_s && !curves(j); --j) {
      near[j] = true;
      if (j == 0) break;
    }
    for (std::size_t j = k; j < n && t_s[j] - t_s[k] <= kMargin_s && !curves(j); ++j) near[j] = true;
  }
  const double noise_mm = std::max(motion.noise_mm, 1e-9);
  for (std::size_t first = 0; first < n; ++first) {
    if (!near[first]) continue;
    std::size_t end = first;
    while (end + 1 < n && near[end + 1] && t_s[end + 1] - t_s[end] < kApart_s) ++end;
    // Fewer readings than this in a corner: there is nothing to choose the strength of the jerk by.
    if (const std::size_t rows = end - first + 1; rows >= kFewest) {
      const double span_s = t_s[end] - t_s[first];
      MotionEnd before = line(motion.velocity_mm_s[first], moves[first], noise_mm, span_s);
      before.position_mm = reading_mm[first];
      before.position_variance_mm2 = 4.0 * noise_mm * noise_mm;
      MotionEnd after = line(motion.velocity_mm_s[end], moves[end], noise_mm, span_s);
      after.position_variance_mm2 = std::numeric_limits<double>::infinity();
      WhiteJerkSmoother corner(t_s.subspan(first, rows), reading_mm.subspan(first, rows), noise_mm, before, after);
      (void)corner.filter_likeliest();
      const auto smoothed = corner.smooth();
      for (std::size_t k = 0; k < rows; ++k) motion.acceleration_mm_s2[first + k] = smoothed[k].mean[2];
    }
    first = end;
  }
}

}  // namespace isorig::identify
