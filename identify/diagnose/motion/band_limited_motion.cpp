#include "identify/diagnose/motion/band_limited_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

/// White noise from fourth differences, median-based: second differences still hold the acceleration of a motion that
/// never stops. Coefficients 1, -4, 6, -4, 1 have a sum of squares of 70.
double fast_noise(std::span<const double> reading) {
  std::vector<double> sizes;
  for (std::size_t k = 2; k + 2 < reading.size(); ++k)
    sizes.push_back(
        std::fabs(reading[k - 2] - 4.0 * reading[k - 1] + 6.0 * reading[k] - 4.0 * reading[k + 1] + reading[k + 2]));
  return base::quantile(std::move(sizes), 0.5) / (base::kNormalQuartile * std::sqrt(70.0));
}

std::vector<double> moving_mean(std::span<const double> values, std::size_t width) {
  const std::size_t n = values.size(), reach = width / 2;
  std::vector<double> sum(n + 1, 0.0), out(n);
  for (std::size_t k = 0; k < n; ++k) sum[k + 1] = sum[k] + (values[k] - values[0]);
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t half = std::min({reach, k, n - 1 - k});
    out[k] = values[0] + (sum[k + half + 1] - sum[k - half]) / static_cast<double>(2 * half + 1);
  }
  return out;
}

}  // namespace

std::vector<double> band_limited(std::span<const double> values, std::size_t width) {
  std::vector<double> out(values.begin(), values.end());
  if (width < 3) return out;
  for (int pass = 0; pass < 3; ++pass) out = moving_mean(out, width);
  return out;
}

std::optional<BandLimitedMotion> band_limited_motion(std::span<const double> t_s, std::span<const double> reading_mm,
                                                     const ChannelQuality& quality) {
  const std::size_t n = t_s.size();
  constexpr std::size_t kFewest = 200;
  if (n < kFewest) return std::nullopt;
  const double dt_s = (t_s.back() - t_s.front()) / static_cast<double>(n - 1);
  std::size_t uneven = 0;
  for (std::size_t k = 1; k < n; ++k) uneven += std::fabs(t_s[k] - t_s[k - 1] - dt_s) > 0.2 * dt_s ? 1 : 0;
  if (uneven > n / 100) return std::nullopt;
  const double noise_mm = std::max(fast_noise(reading_mm), quality.rounding());

  BandLimitedMotion out;
  for (const std::size_t width : {3u, 5u, 7u, 9u, 13u, 17u, 25u, 35u, 49u, 69u}) {
    if (width > n / 20) break;
    const auto x = band_limited(reading_mm, width);
    auto& motion = out.motion;
    motion.position_mm = x;
    motion.velocity_mm_s.assign(n, 0.0);
    motion.acceleration_mm_s2.assign(n, 0.0);
    double power = 0.0;
    for (std::size_t k = 1; k + 1 < n; ++k) {
      motion.velocity_mm_s[k] = 0.5 * (x[k + 1] - x[k - 1]) / dt_s;
      motion.acceleration_mm_s2[k] = (x[k + 1] - 2.0 * x[k] + x[k - 1]) / (dt_s * dt_s);
      if (k > 2 * width && k + 2 * width < n) power += motion.acceleration_mm_s2[k] * motion.acceleration_mm_s2[k];
    }
    motion.velocity_mm_s.front() = motion.velocity_mm_s[1];
    motion.velocity_mm_s.back() = motion.velocity_mm_s[n - 2];
    power /= static_cast<double>(n - 4 * width);
    // Each of two of the three means turns a derivative into a difference over `width` rows: the second derivative is
    //     (m(t + B) - 2 m(t) + m(t - B)) / B^2,   B = width * dt,
    // of the third mean m, whose noise is noise^2 / width and independent at these three instants: 6 of it over B^4.
    const double span_s = static_cast<double>(width) * dt_s;
    const double noise = 6.0 * noise_mm * noise_mm / static_cast<double>(width) / std::pow(span_s, 4);
    out.width = width;
    if (noise > deciding().acceleration_noise_share * power) continue;
    // Sum of squares of the weights of three means in a row: 11/20 over the width (a quadratic B-spline's).
    motion.noise_mm = noise_mm / std::sqrt(1.8 * static_cast<double>(width));
    motion.quantisation_mm = 0.0;
    return out;
  }
  return std::nullopt;
}

}  // namespace isorig::identify
