#include "identify/diagnose/signal/spikes.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

Spikes find_spikes(std::span<const double> t, std::span<const double> f, double noise, std::vector<bool>& usable) {
  Spikes out;
  const std::size_t n = f.size();
  for (std::size_t run = 1; run <= 3; ++run) {
    for (std::size_t k = 2; k + run + 1 < n; ++k) {
      // Rows k .. k+run-1 against the straight line of two readings on either side.
      const auto line = [&](double at, std::size_t left, std::size_t right) {
        const double share = (at - t[left]) / (t[right] - t[left]);
        return (1.0 - share) * f[left] + share * f[right];
      };
      double least = 1e300, most = -1e300;
      bool clear = true;
      for (std::size_t j = k; j < k + run && clear; ++j) {
        if (!usable[j]) clear = false;
        const double near = f[j] - line(t[j], k - 1, k + run);
        const double wide = f[j] - line(t[j], k - 2, k + run + 1);
        for (const double d : {near, wide}) {
          least = std::min(least, d);
          most = std::max(most, d);
        }
      }
      if (!clear || !usable[k - 1] || !usable[k + run] || least * most <= 0.0) continue;
      const double size = std::min(std::fabs(least), std::fabs(most));
      // Neighbours must agree with each other: a corner of a ramp bends them too.
      const double left = std::fabs(f[k - 1] - line(t[k - 1], k - 2, k + run));
      const double right = std::fabs(f[k + run] - line(t[k + run], k - 1, k + run + 1));
      if (size < deciding().spike_noises * noise || size < deciding().spike_ratio * std::max(left, right)) continue;
      for (std::size_t j = k; j < k + run; ++j) {
        usable[j] = false;
        out.rows.push_back(j);
      }
      out.largest = std::max({out.largest, std::fabs(least), std::fabs(most)});
    }
  }
  std::ranges::sort(out.rows);
  return out;
}

Despiked without_spikes(std::span<const double> t_s, std::span<const double> reading_mm,
                        const ChannelQuality& quality) {
  Despiked out{{reading_mm.begin(), reading_mm.end()}, {}, quality};
  const std::size_t n = reading_mm.size();
  if (n < 20) return out;
  const auto [low, high] = std::ranges::minmax_element(reading_mm);
  const double noise = std::max({quality.noise, quality.rounding(), 1e-4 * (*high - *low), 1e-9});
  std::vector<bool> usable(n, true);
  out.spikes = find_spikes(t_s, reading_mm, noise, usable);
  for (const std::size_t row : out.spikes.rows) {
    std::size_t left = row, right = row;
    while (left > 0 && !usable[left]) --left;
    while (right + 1 < n && !usable[right]) ++right;
    const double share = (t_s[row] - t_s[left]) / (t_s[right] - t_s[left]);
    out.reading_mm[row] = (1.0 - share) * reading_mm[left] + share * reading_mm[right];
  }
  if (!out.spikes.rows.empty()) out.quality = channel_quality(t_s, out.reading_mm);
  return out;
}

}  // namespace isorig::identify
