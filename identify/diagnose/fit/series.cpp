#include "identify/diagnose/fit/series.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "identify/diagnose/fit/row_weights.hpp"
#include "identify/diagnose/motion/band_limited_motion.hpp"

namespace isorig::identify {
namespace {

/// One bin per filter width, of motion and force that went through the same filter.
void bin_band_limited(Series& series, const std::vector<bool>& usable) {
  const Excitation& excitation = series.excitation;
  const auto& rows = excitation.instants;
  const std::size_t width = excitation.width;
  // White noise through three means of w rows keeps 66/120 of 1/w of its variance (the B-spline of degree
  // five at its middle), so a bin is worth 1.8 w readings.
  constexpr double kWorth = 120.0 / 66.0;
  std::vector<double> force = series.recording.frame.force_N;
  std::vector<double> lost(force.size(), 0.0);
  for (std::size_t k = 0; k < usable.size(); ++k) {
    if (usable[k]) continue;
    lost[k] = 1.0;
    force[k] = k > 0 ? force[k - 1] : 0.0;
  }
  force = band_limited(force, width);
  lost = band_limited(lost, width);
  for (std::size_t first = 0; first + width <= rows.size(); first += width) {
    const std::size_t k = first + width / 2;
    model::Instant node = rows[k];
    if (!series.nodes.empty()) {
      const std::size_t last = k - width;
      node.dt_s = node.t_s - series.nodes.back().t_s;
      node.step_mm = node.position_mm - series.nodes.back().position_mm;
      node.slide_mm = excitation.slid_mm[k] - excitation.slid_mm[last];
    } else {
      node.dt_s = node.step_mm = node.slide_mm = 0.0;
    }
    // Where the filter hangs over an end it filters less, and lets noise into the acceleration.
    const bool inside = k >= 2 * width && k + 2 * width < rows.size() && lost[k] < 0.1;
    series.nodes.push_back(node);
    series.force_N.push_back(force[k]);
    series.count.push_back(inside ? kWorth * static_cast<double>(width) : 0.0);
    series.first_row.push_back(first);
    series.since_corner_s.push_back(excitation.since_corner_s[k]);
  }
  series.first_row.push_back(rows.size());
}

/// Readings from which the noise could be measured if a rest were kRest_s (noise/noise.cpp).
std::size_t settled_readings(const Series& series) {
  constexpr double kFrom_s = kSettled_rests * kRest_s, kTo_s = kFrom_s + kShortest_rests * kRest_s;
  const double still = still_mm_s(series);
  std::size_t all = 0, in_rest = 0;
  double since_s = 0.0;
  const auto close = [&] {
    if (since_s > kTo_s) all += in_rest;
    in_rest = 0;
  };
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    if (std::fabs(series.nodes[k].velocity_mm_s) >= still || series.since_corner_s[k] < kFrom_s) {
      close();
      continue;
    }
    since_s = series.since_corner_s[k];
    in_rest += series.first_row[k + 1] - series.first_row[k];
  }
  close();
  return all;
}

/// kRest_s where the noise can be measured by it, else less as the motion is faster.
double rest_of(const Series& series) {
  if (settled_readings(series) >= kFewestSettled) return kRest_s;
  double lowest_mm = series.nodes.front().position_mm, highest_mm = lowest_mm, fastest_mm_s = 0.0;
  for (const auto& node : series.nodes) {
    lowest_mm = std::min(lowest_mm, node.position_mm);
    highest_mm = std::max(highest_mm, node.position_mm);
    fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
  }
  if (fastest_mm_s <= 0.0) return kRest_s;
  return std::min(kRest_s, kRest_strokes * (highest_mm - lowest_mm) / fastest_mm_s);
}

}  // namespace

Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable,
                      const RecordingQuality& quality) {
  Series series;
  series.name = std::move(name);
  series.recording = std::move(recording);
  series.force_quality = quality.force;
  series.excitation = reconstruct_excitation(series.recording, quality);
  const auto& rows = series.excitation.instants;
  const auto& force = series.recording.frame.force_N;
  const std::vector<double>& since = series.excitation.since_corner_s;
  RowWeights readings = row_weights(series.recording.frame, quality.force);
  series.reading_noise_N = readings.noise_N;
  if (series.excitation.width > 1) {
    series.readings.assign(rows.size(), 1.0);  // it never rests: there is nothing to average
    bin_band_limited(series, usable);
    return series;
  }
  series.readings = std::move(readings.precision);
  // A bin is at most 2 s wide. In a recording of more than an hour and a bit it may be wider, as long as the specimen
  // moves by no more than a hundredth of the stroke meanwhile: so the number of bins is bounded.
  constexpr double kUsual_s = 2.0, kShareOfElapsed = 0.05, kShareOfDuration = 1.0 / 2000.0, kShareOfStroke = 0.01;
  const double longest_s = std::max(kUsual_s, kShareOfDuration * (rows.back().t_s - rows.front().t_s));
  const auto [lowest, highest] = std::ranges::minmax_element(rows, {}, &model::Instant::position_mm);
  const double furthest_mm = kShareOfStroke * (highest->position_mm - lowest->position_mm);
  const auto in_reach = [&](const model::Instant& from, const model::Instant& to) {
    return to.t_s - from.t_s <= kUsual_s || std::fabs(to.position_mm - from.position_mm) <= furthest_mm;
  };

  const double noise = std::max(quality.force.noise, quality.force.step);
  // A bin in which the force jumps (a grip that slips) would hide the jump: its halves must agree.
  const auto jumps = [&](std::size_t from, std::size_t end) {
    const std::size_t half = (end - from) / 2;
    double a = 0.0, b = 0.0;
    for (std::size_t j = from; j < from + half; ++j) {
      a += force[j];
      b += force[end - 1 - (j - from)];
    }
    return std::fabs(a - b) > 5.0 * noise * std::sqrt(2.0 * static_cast<double>(half));
  };

  double last_slid_mm = 0.0;
  std::size_t k = 0;
  while (k < rows.size()) {
    const std::size_t first = k;
    // The first row stays alone: laws that count from the start begin where `predict` begins.
    const double span_s = first == 0 ? 0.0 : std::min(longest_s, kShareOfElapsed * since[first]);
    model::Instant mean;
    double weight = 0.0, force_sum = 0.0, slid_mm = 0.0;
    std::size_t taken = 0;
    std::size_t end = first + 1;
    while (end < rows.size() && since[end] > 0.0 && rows[end].t_s - rows[first].t_s <= span_s &&
           in_reach(rows[first], rows[end]))
      ++end;
    while (end - first >= 2 && jumps(first, end)) end = first + (end - first) / 2;
    for (; k < end; ++k) {
      ++taken;
      if (!usable.empty() && !usable[k]) continue;
      const model::Instant& row = rows[k];
      const double w = series.readings[k];
      mean.t_s += w * row.t_s;
      mean.position_mm += w * row.position_mm;
      slid_mm += w * series.excitation.slid_mm[k];
      mean.velocity_mm_s += w * row.velocity_mm_s;
      mean.acceleration_mm_s2 += w * row.acceleration_mm_s2;
      mean.excess_pressure_psi += w * row.excess_pressure_psi;
      force_sum += w * force[k];
      weight += w;
    }
    if (weight == 0.0) {
      // Nothing usable: the motion still passes here, and the model must see it.
      mean = rows[first + taken / 2];
      slid_mm = series.excitation.slid_mm[first + taken / 2];
      weight = 1.0;
    }
    mean.t_s /= weight;
    mean.position_mm /= weight;
    mean.velocity_mm_s /= weight;
    mean.acceleration_mm_s2 /= weight;
    mean.excess_pressure_psi /= weight;
    mean.elongation_mm = mean.position_mm + series.excitation.reference.elongation_at_zero_mm;
    mean.slide_mm = slid_mm / weight - last_slid_mm;
    last_slid_mm = slid_mm / weight;
    if (!series.nodes.empty()) {
      mean.dt_s = mean.t_s - series.nodes.back().t_s;
      mean.step_mm = mean.position_mm - series.nodes.back().position_mm;
    } else {
      mean.dt_s = mean.step_mm = mean.slide_mm = 0.0;
    }
    const bool seen = force_sum != 0.0 || usable.empty() ||
                      std::any_of(usable.begin() + static_cast<std::ptrdiff_t>(first),
                                  usable.begin() + static_cast<std::ptrdiff_t>(k), [](bool u) { return u; });
    series.nodes.push_back(mean);
    series.force_N.push_back(force_sum / weight);
    series.count.push_back(seen ? weight : 0.0);
    series.first_row.push_back(first);
    series.since_corner_s.push_back(since[first + taken / 2]);
  }
  series.first_row.push_back(rows.size());
  series.rest_s = rest_of(series);
  return series;
}

Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable) {
  const RecordingQuality quality = recording_quality(recording);
  return prepare_series(std::move(name), std::move(recording), usable, quality);
}

double still_mm_s(const Series& series) {
  double fastest_mm_s = 0.0;
  for (const auto& node : series.nodes) fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
  return 2e-4 * fastest_mm_s;
}

double stroke_mm(std::span<const Series> series) {
  double furthest_mm = 0.0;
  for (const Series& each : series) {
    if (each.nodes.empty()) continue;
    const auto [lowest, highest] = std::ranges::minmax_element(each.nodes, {}, &model::Instant::position_mm);
    furthest_mm = std::max(furthest_mm, highest->position_mm - lowest->position_mm);
  }
  return furthest_mm;
}

Series by_rows(const Series& series, const std::vector<bool>& usable) {
  Series out = series;
  const std::size_t rows = series.excitation.instants.size();
  out.nodes = series.excitation.instants;
  out.force_N = series.recording.frame.force_N;
  out.since_corner_s = series.excitation.since_corner_s;
  out.readings.assign(rows, 1.0);
  out.count.assign(rows, 1.0);
  for (std::size_t k = 0; k < usable.size(); ++k)
    if (!usable[k]) out.count[k] = 0.0;
  out.first_row.resize(rows + 1);
  std::iota(out.first_row.begin(), out.first_row.end(), std::size_t{0});
  return out;
}

void share_noise(std::span<Series> series) {
  constexpr double kClearly = 1.5;
  double most_N = 0.0;
  for (const Series& each : series) most_N = std::max(most_N, each.reading_noise_N);
  for (Series& each : series) {
    if (each.reading_noise_N <= 0.0 || most_N < kClearly * each.reading_noise_N) continue;
    const double ratio = most_N / each.reading_noise_N;
    for (double& count : each.count) count *= ratio * ratio;
    for (double& readings : each.readings) readings *= ratio * ratio;
    each.reading_noise_N = most_N;
  }
}

}  // namespace isorig::identify
