#include "identify/diagnose/fit/row_weights.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/signal/flat_line.hpp"

namespace isorig::identify {
namespace {

struct Bend {
  double t_s = 0.0, size_N = 0.0;
};

/// d ln(noise) / dt in 1/s over groups of neighbouring bends, each of which gives the logarithm l of its median at time
/// t: the slope g of l = a + g t by least squares,
///
///     g    = sum (t - t_mean)(l - l_mean) / sum (t - t_mean)^2
///     se^2 = sum (l - a - g t)^2 / ((G - 2) sum (t - t_mean)^2)
///
/// and 0 where no trend is certain: |g| within some se, or little change from end to end.
double noise_growth(const std::vector<Bend>& bends, double floor_N) {
  constexpr std::size_t kMostGroups = 40;
  const double least_change = std::log(deciding().noise_growth_ratio);
  const std::size_t groups = std::min(bends.size() / deciding().noise_growth_rows, kMostGroups);
  if (groups < deciding().noise_growth_groups) return 0.0;
  std::vector<double> t_s, level;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t from = g * bends.size() / groups, to = (g + 1) * bends.size() / groups;
    std::vector<double> sizes_N;
    for (std::size_t k = from; k < to; ++k) sizes_N.push_back(bends[k].size_N);
    const double median_N = base::quantile_in_place(sizes_N, 0.5);
    if (median_N <= base::kNormalQuartile * floor_N) return 0.0;  // a reading's steps, not its noise
    t_s.push_back(bends[(from + to) / 2].t_s);
    level.push_back(std::log(median_N));
  }
  const auto n = static_cast<double>(groups);
  double mean_s = 0.0, mean = 0.0;
  for (std::size_t g = 0; g < groups; ++g) {
    mean_s += t_s[g] / n;
    mean += level[g] / n;
  }
  double tt = 0.0, tl = 0.0;
  for (std::size_t g = 0; g < groups; ++g) {
    tt += (t_s[g] - mean_s) * (t_s[g] - mean_s);
    tl += (t_s[g] - mean_s) * (level[g] - mean);
  }
  if (tt <= 0.0) return 0.0;
  const double slope = tl / tt;
  double left = 0.0;
  for (std::size_t g = 0; g < groups; ++g) left += std::pow(level[g] - mean - slope * (t_s[g] - mean_s), 2);
  const double error = std::sqrt(left / (n - 2.0) / tt);
  const bool certain = std::fabs(slope) > deciding().noise_growth_standard_errors * error &&
                       std::fabs(slope) * (bends.back().t_s - bends.front().t_s) > least_change;
  return certain ? slope : 0.0;
}

/// Precision of every row under a noise that grows by exp(growth t), relative to its mean square.
std::vector<double> precision_of(const std::vector<double>& per_row, std::span<const double> t_s, double growth_1_s) {
  std::vector<double> out = per_row;
  if (growth_1_s == 0.0) return out;
  double mean_square = 0.0;
  for (const double at_s : t_s) mean_square += std::exp(2.0 * growth_1_s * (at_s - t_s[0]));
  mean_square /= static_cast<double>(t_s.size());
  for (std::size_t k = 0; k < t_s.size(); ++k) out[k] *= mean_square / std::exp(2.0 * growth_1_s * (t_s[k] - t_s[0]));
  return out;
}

}  // namespace

RowWeights row_weights(const messages::FrameSamples& frame, const ChannelQuality& force_quality) {
  const auto& t_s = frame.t_s;
  const auto& force_N = frame.force_N;
  const std::size_t n = t_s.size();
  RowWeights out;
  out.per_row.assign(n, 1.0);
  out.precision = out.per_row;
  const double floor_N = force_quality.rounding();
  out.noise_N = std::max(force_quality.noise, floor_N);
  if (n < 3) return out;

  struct Spacing {
    double sum_s = 0.0;
    std::size_t rows = 0;
    std::vector<Bend> bends;
    double noise_N = 0.0;
  };
  const double width = std::log(deciding().spacing_ratio);
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
  // A dead channel has no noise, and would look like an amplifier that has become silent.
  std::vector<bool> is_dead(n, false);
  for (const auto& [first, end] : flat_runs(force_N, force_quality))
    for (std::size_t k = first; k < end; ++k) is_dead[k] = true;
  for (std::size_t k = 1; k + 1 < n; ++k) {
    if (spacing_of[k - 1] != spacing_of[k] || spacing_of[k + 1] != spacing_of[k]) continue;
    if (is_dead[k]) continue;
    // b = F_k - (1 - s) F_k-1 - s F_k+1 of three rows alike has the variance noise^2 (1 + s^2 + (1 - s)^2).
    const double share = (t_s[k] - t_s[k - 1]) / (t_s[k + 1] - t_s[k - 1]);
    const double bend = force_N[k] - ((1.0 - share) * force_N[k - 1] + share * force_N[k + 1]);
    const double scale = std::sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share));
    spacings[spacing_of[k]].bends.push_back({t_s[k], std::fabs(bend) / scale});
  }
  // The finest spacing with rows enough to judge by is what one reading is.
  const Spacing* one = nullptr;
  for (auto& [number, spacing] : spacings) {
    if (spacing.bends.size() < deciding().fewest_rows_of_a_spacing) continue;
    std::vector<double> sizes_N;
    for (const Bend& bend : spacing.bends) sizes_N.push_back(bend.size_N);
    spacing.noise_N = std::max(base::quantile_in_place(sizes_N, 0.5) / base::kNormalQuartile, floor_N);
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
    if (readings >= deciding().averaged_readings) out.per_row[k] = readings;
  }
  out.precision = precision_of(out.per_row, t_s, noise_growth(one->bends, floor_N));
  return out;
}

}  // namespace isorig::identify
