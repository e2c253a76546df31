#pragma once
#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace isorig::base {

/// The value that a share of the others lies below, 0 <= share <= 1: the one at floor(share n) in order, not
/// interpolated, so that it is one of the values. NaN when empty. Order changes; no allocation.
[[nodiscard]] inline double quantile_in_place(std::span<double> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto at = std::min(static_cast<std::size_t>(share * static_cast<double>(values.size())), values.size() - 1);
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(at);
  std::nth_element(values.begin(), place, values.end());
  return *place;
}
[[nodiscard]] inline double quantile(std::vector<double> values, double share) {
  return quantile_in_place(values, share);
}

/// Half of all normal errors are smaller than this many standard deviations: median |e| / kNormalQuartile is a standard
/// deviation that outliers do not move (Hampel 1974).
inline constexpr double kNormalQuartile = 0.6745;

/// The middle value, the mean of the two in the middle when their number is even; NaN when empty.
[[nodiscard]] inline double median(std::vector<double> values) {
  const double upper = quantile_in_place(values, 0.5);
  if (values.empty() || values.size() % 2 == 1) return upper;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  return 0.5 * (upper + *std::max_element(values.begin(), middle));
}

}  // namespace isorig::base
