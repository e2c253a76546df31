#include "identify/diagnose/fit/merged_bins.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify {
namespace {

/// Bins from to end - 1 as one; `slid_mm` is where each has slid to since the first.
struct Merged {
  model::Instant node;
  double slid_mm = 0.0, force_N = 0.0, count = 0.0;
};
Merged merge(const Series& series, std::span<const double> slid_mm, std::size_t from, std::size_t end) {
  Merged out;
  for (std::size_t k = from; k < end; ++k) out.count += series.count[k];
  if (out.count == 0.0 || end - from == 1) {
    out.node = series.nodes[end - 1];
    out.slid_mm = slid_mm[end - 1];
    out.force_N = series.force_N[end - 1];
    return out;
  }
  model::Instant& mean = out.node;
  mean.elongation_mm = 0.0;
  for (std::size_t k = from; k < end; ++k) {
    const model::Instant& bin = series.nodes[k];
    const double share = series.count[k] / out.count;
    mean.t_s += share * bin.t_s;
    mean.position_mm += share * bin.position_mm;
    mean.elongation_mm += share * bin.elongation_mm;
    mean.velocity_mm_s += share * bin.velocity_mm_s;
    mean.acceleration_mm_s2 += share * bin.acceleration_mm_s2;
    mean.excess_pressure_psi += share * bin.excess_pressure_psi;
    out.slid_mm += share * slid_mm[k];
    out.force_N += share * series.force_N[k];
  }
  return out;
}

/// From bin `from` to the next the force goes further than the changes beside it lead to expect, by more than noise: a
/// grip that slips, which a mean over both would hide.
bool jumps(const Series& series, std::size_t from) {
  const auto& f = series.force_N;
  const std::size_t to = from + 1;
  const double readings = std::min(series.count[from], series.count[to]);
  if (from == 0 || to + 1 >= f.size() || readings == 0.0) return false;
  const auto rate = [&](std::size_t k) { return (f[k + 1] - f[k]) / series.nodes[k + 1].dt_s; };
  const double expected = 0.5 * (rate(from - 1) + rate(to)) * series.nodes[to].dt_s;
  const double noise_N = std::max(series.force_quality.noise, series.force_quality.step);
  return std::fabs(f[to] - f[from] - expected) > deciding().bin_jump_deviations * noise_N * std::sqrt(2.0 / readings);
}

Series merged(const Series& series, std::size_t together) {
  Series out;
  out.name = series.name;
  out.excitation.reference = series.excitation.reference;
  out.excitation.width = series.excitation.width;
  out.reading_noise_N = series.reading_noise_N;
  out.rest_s = series.rest_s;
  out.noise_reading_s = series.noise_reading_s;
  const std::size_t bins = series.nodes.size();
  std::vector<double> slid_mm(bins, 0.0);
  for (std::size_t k = 1; k < bins; ++k) {
    const model::Instant& bin = series.nodes[k];
    slid_mm[k] = slid_mm[k - 1] + (std::isnan(bin.slide_mm) ? bin.step_mm : bin.slide_mm);
  }
  double last_slid_mm = 0.0;
  for (std::size_t from = 0, end = 0; from < bins; from = end) {
    end = from + 1;
    // The first bin stays alone: laws that count from the start begin there.
    while (from > 0 && end < bins && end - from < together &&
           series.since_corner_s[end] > series.since_corner_s[end - 1] && !jumps(series, end - 1))
      ++end;
    Merged bin = merge(series, slid_mm, from, end);
    if (!out.nodes.empty()) {
      bin.node.dt_s = bin.node.t_s - out.nodes.back().t_s;
      bin.node.step_mm = bin.node.position_mm - out.nodes.back().position_mm;
      bin.node.slide_mm = bin.slid_mm - last_slid_mm;
    }
    last_slid_mm = bin.slid_mm;
    out.nodes.push_back(bin.node);
    out.force_N.push_back(bin.force_N);
    out.count.push_back(bin.count);
    out.first_row.push_back(series.first_row[from]);
    out.since_corner_s.push_back(series.since_corner_s[from + (end - from) / 2]);
  }
  out.first_row.push_back(series.first_row.back());
  return out;
}

}  // namespace

std::vector<Series> merged_bins(std::span<const Series> series, std::size_t together) {
  std::vector<Series> out;
  out.reserve(series.size());
  for (const Series& each : series) out.push_back(merged(each, together));
  return out;
}

}  // namespace isorig::identify
