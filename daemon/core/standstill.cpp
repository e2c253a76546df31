#include "daemon/core/standstill.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isorig::daemon {
namespace {

// The longest window fits into the ring, whatever the frame's rate.
constexpr std::int64_t kLeastSpacingNs = 1'000'000;
// Whether a window is short enough to decide: a noise bound above this calls for a longer one.
constexpr double kGoodBound_mm_s = 0.03;

}  // namespace

double Standstill::tells_after_s(double spacing_s) noexcept {
  constexpr double kLeastSteps = kLeastSamples - 1;
  for (const double window_s : kWindows_s) {
    // A window ends at the first sample beyond it.
    if (window_s > (kLeastSteps - 1.0) * spacing_s) return window_s + spacing_s;
  }
  const double stretched_s = kLeastSteps * spacing_s;
  return stretched_s > kLongest_s ? std::numeric_limits<double>::infinity() : stretched_s;
}

void Standstill::restart(double speed_mm_s) noexcept {
  count_ = 0;
  stood_ = false;
  velocity_mm_s_ = bound_mm_s_ = 0.0;
  floor_mm_s_ = std::max(kSlowest_mm_s, kSpeedShare * std::abs(speed_mm_s));
}

void Standstill::add(std::int64_t mono_ns, double position_mm) noexcept {
  // Half the spacing, since stamps scatter.
  if (!std::isfinite(position_mm)) return;
  if (count_ > 0 && mono_ns - back(0).mono_ns < kLeastSpacingNs / 2) return;
  points_[count_ % kCapacity] = {mono_ns, position_mm};
  ++count_;
}

bool Standstill::fit(double window_s, bool stretches) noexcept {
  const std::size_t held = std::min(count_, kCapacity);
  if (held < kLeastSamples) return false;
  const auto window_ns = static_cast<std::int64_t>(window_s * 1e9);
  const std::int64_t newest_ns = back(0).mono_ns;
  std::size_t n = 1;
  const auto needs_more = [&] {
    return newest_ns - back(n - 1).mono_ns < window_ns || (stretches && n < kLeastSamples);
  };
  while (n < held && needs_more()) ++n;
  if (n < kLeastSamples || needs_more()) return false;
  const double spanned_s = static_cast<double>(newest_ns - back(n - 1).mono_ns) * 1e-9;
  if (stretches && spanned_s > std::max(window_s, kLongest_s)) return false;

  // Side by side and newest first: the ring's arithmetic once for each sample.
  std::array<double, kCapacity> t_s, x_mm;
  double mean_t_s = 0.0, mean_mm = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Point& point = back(i);
    t_s[i] = static_cast<double>(point.mono_ns - newest_ns) * 1e-9;
    x_mm[i] = point.position_mm;
    mean_t_s += t_s[i];
    mean_mm += x_mm[i];
  }
  const auto count = static_cast<double>(n);
  mean_t_s /= count;
  mean_mm /= count;
  double tt = 0.0, tx = 0.0, xx = 0.0, second = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double t = t_s[i] - mean_t_s, x = x_mm[i] - mean_mm;
    tt += t * t;
    tx += t * x;
    xx += x * x;
    if (i >= 2) {
      const double d = x_mm[i] - 2.0 * x_mm[i - 1] + x_mm[i - 2];
      second += d * d;
    }
  }
  if (!(tt > 0.0)) return false;
  velocity_mm_s_ = tx / tt;
  // White noise of variance s^2 has second differences of 6 s^2, and a slope of s^2 / tt.
  const double sigma_mm = std::sqrt(second / (6.0 * (count - 2.0)));
  bound_mm_s_ = kNoiseSigmas * sigma_mm / std::sqrt(tt);
  // What is left beside a straight line: a crosshead that swings has a moment without a slope.
  const double rest_mm = std::sqrt(std::max(0.0, xx - tx * tx / tt) / count);
  swings_ = rest_mm > std::max(2.0 * sigma_mm, 0.5 * floor_mm_s_ * window_s);
  mean_mm_ = mean_mm;
  return std::isfinite(velocity_mm_s_) && std::isfinite(bound_mm_s_);
}

bool Standstill::stands() noexcept {
  bool stands = false;
  for (std::size_t i = 0; i < kWindows_s.size(); ++i) {
    if (!fit(kWindows_s[i], i + 1 == kWindows_s.size()))
      continue;  // not yet full, or too few samples: a longer one may have enough
    const double bound_mm_s = std::max(floor_mm_s_, bound_mm_s_);
    stands = std::abs(velocity_mm_s_) <= (stood_ ? 2.0 : 1.0) * bound_mm_s && (stood_ || !swings_);
    if (bound_mm_s_ <= kGoodBound_mm_s) break;
    if (i + 1 < kWindows_s.size()) stands = false;  // too noisy to say by this window alone
  }
  stood_ = stands;
  return stands;
}

}  // namespace isorig::daemon
