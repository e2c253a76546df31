#pragma once
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace isorig::identify {

/// What a measure is that nothing could be read off for.
inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// What a position signal says about its own noise. Sampling need not be uniform.
struct SignalNoise {
  double sigma = 0.0;    ///< white noise, 1 standard deviation
  double quantum = 0.0;  ///< smallest step between two samples (0: continuous, or a constant signal)
};

/// Noise from each sample's distance to the line through its neighbours (at two spacings, the larger counts,
/// so that noise that is correlated from sample to sample is not taken for motion). Median based: motion,
/// corners and outliers in less than half of the samples do not matter.
[[nodiscard]] SignalNoise estimate_noise(std::span<const double> t_s, std::span<const double> values);

/// Polyline through chosen samples that leaves no sample further away than `tolerance` (Ramer 1972; Douglas
/// and Peucker 1973, with the distance taken along the value). Returns indices, first and last included.
/// About n log n; needs t_s strictly increasing.
[[nodiscard]] std::vector<std::size_t> polyline(std::span<const double> t_s, std::span<const double> values,
                                                double tolerance);

/// Least-squares line y = mean + slope (t - t_mean), with standard errors from its own residuals that allow
/// for correlation of neighbours (first-order). `se_*` are NaN with fewer than 3 samples.
struct Line {
  std::size_t samples = 0;
  double t_mean = 0.0;
  double mean = 0.0;
  double slope = 0.0;
  double residual_sd = 0.0;
  double se_mean = 0.0;
  double se_slope = 0.0;
  [[nodiscard]] double at(double t) const noexcept { return mean + slope * (t - t_mean); }
  /// Standard error of at(t).
  [[nodiscard]] double se_at(double t) const noexcept;
};
[[nodiscard]] Line fit_line(std::span<const double> t, std::span<const double> y);

}  // namespace isorig::identify
