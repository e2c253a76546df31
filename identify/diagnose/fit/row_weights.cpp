#include "identify/diagnose/fit/row_weights.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/quantile.hpp"
#include "identify/diagnose/signal/noise_level.hpp"

namespace isorig::identify {

RowWeights row_weights(const messages::FrameSamples& frame) {
  const auto& t_s = frame.t_s;
  const auto& force_N = frame.force_N;
  const std::size_t n = t_s.size();
  RowWeights out;
  out.per_row.assign(n, 1.0);
  const double floor_N = quantisation(force_N) / std::sqrt(12.0);
  out.noise_N = std::max(white_noise(t_s, force_N), floor_N);
  if (n < 3) return out;

  struct Spacing {
    double sum_s = 0.0;
    std::size_t rows = 0;
    std::vector<double> bends_N;
    double noise_N = 0.0;
  };
  const double width = std::log(2.5);
  std::vector<int> spacing_of(n, 0);
  std::map<int, Spacing> spacings;
  for (std::size_t k = 0; k < n; ++k) {
    const double before_s = k > 0 ? t_s[k] - t_s[k - 1] : HUGE_VAL;
    const double after_s = k + 1 < n ? t_s[k + 1] - t_s[k] : HUGE_VAL;
    const double gap_s = std::min(before_s, after_s);
    spacing_of[k] = static_cast<int>(std::lround(std::log(gap_s) / width));
    Spacing& spacing = spacings[spacing_of[k]];
    spacing.sum_s += gap_s;
    ++spacing.rows;
  }
  for (std::size_t k = 1; k + 1 < n; ++k) {
    if (spacing_of[k - 1] != spacing_of[k] || spacing_of[k + 1] != spacing_of[k]) continue;
    const double share = (t_s[k] - t_s[k - 1]) / (t_s[k + 1] - t_s[k - 1]);
    const double bend = force_N[k] - ((1.0 - share) * force_N[k - 1] + share * force_N[k + 1]);
    spacings[spacing_of[k]].bends_N.push_back(std::fabs(bend) /
                                              std::sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share)));
  }
  // The finest spacing with rows enough to judge by is what one reading is.
  constexpr std::size_t kEnough = 150;
  constexpr double kClearly = 4.0;
  const Spacing* one = nullptr;
  for (auto& [number, spacing] : spacings) {
    if (spacing.bends_N.size() < kEnough) continue;
    spacing.noise_N = std::max(base::quantile_in_place(spacing.bends_N, 0.5) / base::kNormalQuartile, floor_N);
    if (one == nullptr) one = &spacing;
  }
  if (one == nullptr || one->noise_N <= 0.0) return out;
  out.noise_N = one->noise_N;
  for (std::size_t k = 0; k < n; ++k) {
    const Spacing& spacing = spacings[spacing_of[k]];
    if (&spacing == one || spacing.noise_N <= 0.0) continue;
    // No mean holds more readings than fit in its time.
    const double fit =
        (spacing.sum_s / static_cast<double>(spacing.rows)) / (one->sum_s / static_cast<double>(one->rows));
    const double ratio = one->noise_N / spacing.noise_N;
    const double readings = std::min(ratio * ratio, fit);
    if (readings >= kClearly) out.per_row[k] = readings;
  }
  return out;
}

}  // namespace isorig::identify
