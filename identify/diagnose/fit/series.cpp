#include "identify/diagnose/fit/series.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "identify/diagnose/deciding/deciding.hpp"
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

/// Which rows a bin holds. It widens with the time since the last corner, and is at most 2 s wide. In a recording of
/// more than an hour and a bit it may be wider, as long as the specimen moves by no more than a hundredth of the stroke
/// meanwhile: so the number of bins is bounded.
class BinLimits {
 public:
  BinLimits(const Series& series, const ChannelQuality& force)
      : rows_(series.excitation.instants),
        since_s_(series.excitation.since_corner_s),
        force_N_(series.recording.frame.force_N),
        longest_s_(std::max(deciding().bin_longest_s,
                            deciding().bin_share_of_duration * (rows_.back().t_s - rows_.front().t_s))),
        noise_N_(std::max(force.noise, force.step)),
        bend_mm_(deciding().bin_bend_noises *
                 std::max(series.excitation.motion.noise_mm, series.excitation.motion.quantisation_mm)) {
    const auto [lowest, highest] = std::ranges::minmax_element(rows_, {}, &model::Instant::position_mm);
    furthest_mm_ = deciding().bin_share_of_stroke * (highest->position_mm - lowest->position_mm);
  }

  /// The first row after a bin that begins with row `first`.
  [[nodiscard]] std::size_t end_of(std::size_t first) const {
    // The first row stays alone: laws that count from the start begin where `predict` begins.
    const double span_s = first == 0 ? 0.0 : std::min(longest_s_, deciding().bin_share_of_elapsed * since_s_[first]);
    std::size_t end = first + 1;
    while (end < rows_.size() && since_s_[end] > 0.0 && rows_[end].t_s - rows_[first].t_s <= span_s &&
           in_reach(rows_[first], rows_[end]))
      ++end;
    while (end - first >= 2 && (jumps(first, end) || bends(first, end))) end = first + (end - first) / 2;
    return end;
  }

 private:
  [[nodiscard]] bool in_reach(const model::Instant& from, const model::Instant& to) const {
    return to.t_s - from.t_s <= deciding().bin_longest_s ||
           std::fabs(to.position_mm - from.position_mm) <= furthest_mm_;
  }
  /// A bin in which the force jumps (a grip that slips) would hide the jump: its halves must agree.
  [[nodiscard]] bool jumps(std::size_t from, std::size_t end) const {
    const std::size_t half = (end - from) / 2;
    double a = 0.0, b = 0.0;
    for (std::size_t j = from; j < from + half; ++j) {
      a += force_N_[j];
      b += force_N_[end - 1 - (j - from)];
    }
    return std::fabs(a - b) > deciding().bin_jump_deviations * noise_N_ * std::sqrt(2.0 * static_cast<double>(half));
  }

  /// What relaxes is driven straight from bin to bin: within a bin the motion must stay near the line between its ends.
  [[nodiscard]] bool bends(std::size_t from, std::size_t end) const {
    const model::Instant &a = rows_[from], &b = rows_[end - 1];
    const double speed_mm_s = (b.position_mm - a.position_mm) / (b.t_s - a.t_s);
    for (std::size_t k = from + 1; k + 1 < end; ++k)
      if (std::fabs(rows_[k].position_mm - a.position_mm - speed_mm_s * (rows_[k].t_s - a.t_s)) > bend_mm_) return true;
    return false;
  }

  std::span<const model::Instant> rows_;
  std::span<const double> since_s_, force_N_;
  double longest_s_, noise_N_, bend_mm_, furthest_mm_ = 0.0;
};

/// What the rows of a bin show in the mean, each with the weight of its readings.
struct Bin {
  model::Instant mean;
  double slid_mm = 0.0, force_N = 0.0;
  double readings = 0.0;  ///< 0: the guard left none of its rows in
};
Bin mean_of_rows(const Series& series, const std::vector<bool>& usable, std::size_t first, std::size_t end) {
  const auto& rows = series.excitation.instants;
  const auto& force_N = series.recording.frame.force_N;
  Bin bin;
  auto& [mean, slid_mm, force_sum, weight] = bin;
  bool seen = usable.empty();
  for (std::size_t k = first; k < end; ++k) {
    if (!usable.empty() && !usable[k]) continue;
    seen = true;
    const model::Instant& row = rows[k];
    const double w = series.readings[k];
    mean.t_s += w * row.t_s;
    mean.position_mm += w * row.position_mm;
    slid_mm += w * series.excitation.slid_mm[k];
    mean.velocity_mm_s += w * row.velocity_mm_s;
    mean.acceleration_mm_s2 += w * row.acceleration_mm_s2;
    mean.excess_pressure_psi += w * row.excess_pressure_psi;
    force_sum += w * force_N[k];
    weight += w;
  }
  if (weight == 0.0) {
    // Nothing usable: the motion still passes here, and the model must see it.
    const std::size_t middle = first + (end - first) / 2;
    mean = rows[middle];
    slid_mm = series.excitation.slid_mm[middle];
    weight = 1.0;
  }
  mean.t_s /= weight;
  mean.position_mm /= weight;
  mean.velocity_mm_s /= weight;
  mean.acceleration_mm_s2 /= weight;
  mean.excess_pressure_psi /= weight;
  mean.elongation_mm = mean.position_mm + series.excitation.reference.elongation_at_zero_mm;
  slid_mm /= weight;
  force_sum /= weight;
  if (!seen) weight = 0.0;
  return bin;
}

/// Bins as wide as the motion allows.
void bin_by_corners(Series& series, const std::vector<bool>& usable, const ChannelQuality& force) {
  const BinLimits limits(series, force);
  const std::size_t rows = series.excitation.instants.size();
  double last_slid_mm = 0.0;
  for (std::size_t first = 0, end = 0; first < rows; first = end) {
    end = limits.end_of(first);
    Bin bin = mean_of_rows(series, usable, first, end);
    if (!series.nodes.empty()) {
      bin.mean.dt_s = bin.mean.t_s - series.nodes.back().t_s;
      bin.mean.step_mm = bin.mean.position_mm - series.nodes.back().position_mm;
      bin.mean.slide_mm = bin.slid_mm - last_slid_mm;
    } else {
      bin.mean.dt_s = bin.mean.step_mm = bin.mean.slide_mm = 0.0;
    }
    last_slid_mm = bin.slid_mm;
    series.nodes.push_back(bin.mean);
    series.force_N.push_back(bin.force_N);
    series.count.push_back(bin.readings);
    series.first_row.push_back(first);
    series.since_corner_s.push_back(series.excitation.since_corner_s[first + (end - first) / 2]);
  }
  series.first_row.push_back(rows);
}

/// Readings from which the noise could be measured if a rest were deciding().rest_s (noise/noise.cpp).
std::size_t settled_readings(const Series& series) {
  const double from_s = deciding().settled_rests * deciding().rest_s,
               to_s = from_s + deciding().shortest_rests * deciding().rest_s;
  const double still = still_mm_s(series);
  std::size_t all = 0, in_rest = 0;
  double since_s = 0.0;
  const auto close = [&] {
    if (since_s > to_s) all += in_rest;
    in_rest = 0;
  };
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    if (std::fabs(series.nodes[k].velocity_mm_s) >= still || series.since_corner_s[k] < from_s) {
      close();
      continue;
    }
    since_s = series.since_corner_s[k];
    in_rest += series.first_row[k + 1] - series.first_row[k];
  }
  close();
  return all;
}

/// deciding().rest_s where the noise can be measured by it, else less as the motion is faster.
double rest_of(const Series& series) {
  if (settled_readings(series) >= deciding().fewest_settled_readings) return deciding().rest_s;
  double lowest_mm = series.nodes.front().position_mm, highest_mm = lowest_mm, fastest_mm_s = 0.0;
  for (const auto& node : series.nodes) {
    lowest_mm = std::min(lowest_mm, node.position_mm);
    highest_mm = std::max(highest_mm, node.position_mm);
    fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
  }
  if (fastest_mm_s <= 0.0) return deciding().rest_s;
  return std::min(deciding().rest_s, deciding().rest_strokes * (highest_mm - lowest_mm) / fastest_mm_s);
}

}  // namespace

Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable,
                      const RecordingQuality& quality) {
  Series series;
  series.name = std::move(name);
  series.recording = std::move(recording);
  series.force_quality = quality.force;
  series.excitation = reconstruct_excitation(series.recording, quality);
  RowWeights readings = row_weights(series.recording.frame, quality.force);
  series.reading_noise_N = readings.noise_N;
  if (series.excitation.width > 1) {
    // It never rests: there is nothing to average.
    series.readings.assign(series.excitation.instants.size(), 1.0);
    bin_band_limited(series, usable);
    return series;
  }
  series.readings = std::move(readings.precision);
  bin_by_corners(series, usable, quality.force);
  series.rest_s = rest_of(series);
  return series;
}

Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable) {
  const RecordingQuality quality = recording_quality(recording);
  return prepare_series(std::move(name), std::move(recording), usable, quality);
}

std::size_t series_of(const model::Part& event, std::span<const Series> series) {
  for (std::size_t i = 0; i < event.parameters.size(); ++i) {
    if (event.law->parameters[i].traits.filled_by != model::FilledBy::kRecordingId) continue;
    const auto found = std::ranges::find(series, event.parameters[i],
                                         [](const Series& s) { return s.excitation.reference.recording_id; });
    if (found != series.end()) return static_cast<std::size_t>(found - series.begin());
  }
  return 0;
}

double noise_dt_s(const Series& series, std::size_t k) {
  if (series.noise_reading_s <= 0.0) return series.nodes[k].dt_s;
  return 0.5 * static_cast<double>(series.first_row[k + 1] - series.first_row[k - 1]) * series.noise_reading_s;
}

double still_mm_s(const Series& series) {
  double fastest_mm_s = 0.0;
  for (const auto& node : series.nodes) fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
  return deciding().still_speed_share * fastest_mm_s;
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
  double most_N = 0.0;
  for (const Series& each : series) most_N = std::max(most_N, each.reading_noise_N);
  for (Series& each : series) {
    if (each.reading_noise_N <= 0.0 || most_N < deciding().other_noise_ratio * each.reading_noise_N) continue;
    const double ratio = most_N / each.reading_noise_N;
    for (double& count : each.count) count *= ratio * ratio;
    for (double& readings : each.readings) readings *= ratio * ratio;
    each.reading_noise_N = most_N;
  }
}

}  // namespace isorig::identify
