#include "identify/diagnose/guard/guard.hpp"

#include <algorithm>
#include <array>
#include <boost/math/distributions/binomial.hpp>
#include <cmath>
#include <limits>

#include "base/number_text.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/guard/gaps.hpp"
#include "identify/diagnose/guard/pressure_coverage.hpp"
#include "identify/diagnose/signal/flat_line.hpp"
#include "identify/diagnose/signal/spikes.hpp"

namespace isorig::identify {
namespace {

std::string in_four_digits(double value) {
  return base::number_text(value, 4);
}

constexpr std::size_t kHalf = 4;  // of the nine readings that an outlier is compared with

/// Distance of a reading from the median of the nine round it.
double off_median(const std::vector<double>& f, std::size_t k, std::array<double, 2 * kHalf + 1>& near) {
  const std::size_t from = std::clamp<std::size_t>(k, kHalf, f.size() - kHalf - 1) - kHalf;
  std::copy_n(f.begin() + static_cast<std::ptrdiff_t>(from), near.size(), near.begin());
  const double median = base::quantile_in_place(near, 0.5);
  for (std::size_t j = 0; j < near.size(); ++j) near[j] = std::fabs(f[from + j] - median);
  return std::fabs(f[k] - median);
}

/// Where the crosshead's velocity changes by a tenth of its largest within three readings on either side.
std::vector<bool> corners_of_motion(const std::vector<double>& t_s, const std::vector<double>& position_mm) {
  constexpr std::size_t kReadings = 3;
  constexpr double kShare = 0.1;
  const std::size_t n = t_s.size();
  const auto velocity = [&](std::size_t from) {
    return (position_mm[from + kReadings] - position_mm[from]) / (t_s[from + kReadings] - t_s[from]);
  };
  std::vector<bool> corners(n, false);
  if (n < 2 * kReadings + 3) return corners;
  double fastest_mm_s = 0.0;
  for (std::size_t k = 0; k + kReadings < n; ++k) fastest_mm_s = std::max(fastest_mm_s, std::fabs(velocity(k)));
  for (std::size_t k = kReadings + 1; k + kReadings + 1 < n; ++k)
    corners[k] = std::fabs(velocity(k + 1) - velocity(k - kReadings - 1)) > kShare * fastest_mm_s;
  return corners;
}

/// How many of the jumps stand at corners of the motion, where that is more than chance would put there; else 0. A mass
/// that is accelerated, a play that closes, make forces for a reading or two there.
std::size_t jumps_at_corners(const messages::FrameSamples& frame, const ChannelQuality& position,
                             const std::vector<std::size_t>& rows) {
  const auto corners = corners_of_motion(frame.t_s, without_spikes(frame.t_s, frame.position_mm, position).reading_mm);
  const auto at = std::ranges::count_if(rows, [&](std::size_t k) { return corners[k]; });
  const double share = static_cast<double>(std::ranges::count(corners, true)) /
                       static_cast<double>(std::max<std::size_t>(1, corners.size()));
  if (at < 2 || share <= 0.0 || share >= 1.0) return 0;
  const boost::math::binomial by_chance(static_cast<double>(rows.size()), share);
  const double chance = cdf(complement(by_chance, static_cast<double>(at) - 1.0));
  return chance > deciding().outliers_at_corners_chance ? 0 : static_cast<std::size_t>(at);
}

void find_outliers(const messages::FrameSamples& frame, const RecordingQuality& of, Guarded& out) {
  const auto& t = frame.t_s;
  const auto& f = frame.force_N;
  const ChannelQuality& quality = of.force;
  const std::size_t n = f.size();
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  // Simulated force may have no noise at all: then only what stands out of its range can be a fault.
  const double noise = std::max({quality.noise, quality.rounding(), 1e-4 * (*high - *low), 1e-9});
  std::vector<std::size_t> rows = find_spikes(t, f, noise, out.usable).rows;
  // Several close together hide each other from their neighbours, not from the median of nine. The limit
  // grows with the spread within the nine, so that steep motion is not taken for a fault.
  std::array<double, 2 * kHalf + 1> near{};
  for (std::size_t k = kHalf; k + kHalf < n; ++k) {
    if (!out.usable[k]) continue;
    const double away = off_median(f, k, near);
    if (away < deciding().outlier_noises * noise) continue;
    if (away < deciding().outlier_ratio * base::quantile_in_place(near, 0.5)) continue;
    out.usable[k] = false;
    rows.push_back(k);
  }
  std::ranges::sort(rows);
  if (rows.empty()) return;
  const std::size_t at_corners = jumps_at_corners(frame, of.position, rows);
  const std::string corners =
      at_corners == 0 ? ""
                      : ", though " + std::to_string(at_corners) +
                            " of them stand where the motion turns: a mass or a play makes such jumps, and what is "
                            "found of it here is found without them";
  double largest = 0.0;
  for (const std::size_t k : rows) largest = std::max(largest, off_median(f, k, near));
  out.faults.push_back({"outliers", t[rows.front()], t[rows.back()], rows.size(),
                        std::to_string(rows.size()) +
                            " force readings jump away from their neighbours and back, by up to " +
                            in_four_digits(largest) + " N; left out" + corners});
}

/// The motion is reconstructed without them (motion/reconstruction.cpp); the force there is as good as elsewhere.
void find_position_outliers(const messages::FrameSamples& frame, const ChannelQuality& quality, Guarded& out) {
  const Spikes spikes = without_spikes(frame.t_s, frame.position_mm, quality).spikes;
  if (spikes.rows.empty()) return;
  out.faults.push_back({"outliers", frame.t_s[spikes.rows.front()], frame.t_s[spikes.rows.back()], spikes.rows.size(),
                        std::to_string(spikes.rows.size()) +
                            " position readings jump away from their neighbours and back, by up to " +
                            in_four_digits(spikes.largest) + " mm; bridged"});
}

constexpr double kNoEnd = std::numeric_limits<double>::infinity();

/// Where the force comes within its noise of the end of the range, the noise is clipped on that side: the readings
/// there show less noise than there is, and a mean that is too low.
void leave_out_near_the_end_of_the_range(const messages::FrameSamples& frame, double least_N, double most_N,
                                         double within_N, Guarded& out) {
  std::size_t count = 0, first = 0, last = 0;
  for (std::size_t k = 0; k < frame.size(); ++k) {
    const double force_N = frame.force_N[k];
    if (!out.usable[k] || (force_N > least_N + within_N && force_N < most_N - within_N)) continue;
    out.usable[k] = false;
    if (count++ == 0) first = k;
    last = k;
  }
  if (count > 0)
    out.faults.push_back({"saturation", frame.t_s[first], frame.t_s[last], count,
                          std::to_string(count) + " force readings are within " + in_four_digits(within_N) +
                              " N of the end of its range, which clips their noise; left out"});
}

void find_frozen(const messages::Recording& recording, const RecordingQuality& quality, Guarded& out) {
  const auto& t = recording.frame.t_s;
  const auto& f = recording.frame.force_N;
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  bool at_least = false, at_most = false;
  for (const auto& [k, end] : flat_runs(f, quality.force)) {
    const bool edge = f[k] == *low || f[k] == *high;
    at_least = at_least || f[k] == *low;
    at_most = at_most || f[k] == *high;
    for (std::size_t j = k; j < end; ++j) out.usable[j] = false;
    out.faults.push_back({edge ? "saturation" : "frozen", t[k], t[end - 1], end - k,
                          edge
                              ? "force stands at the end of its range, " + in_four_digits(f[k]) + " N; left out"
                              : "force does not change at all for " + std::to_string(end - k) + " readings; left out"});
  }
  leave_out_near_the_end_of_the_range(recording.frame, at_least ? *low : -kNoEnd, at_most ? *high : kNoEnd,
                                      deciding().clipped_noises * quality.force.noise, out);
  for (const auto& [k, end] : flat_runs(recording.frame.position_mm, quality.position)) {
    for (std::size_t j = k; j < end; ++j) out.usable[j] = false;
    out.faults.push_back({"frozen", t[k], t[end - 1], end - k,
                          "position does not change at all for " + std::to_string(end - k) +
                              " readings; bridged, and the force meanwhile left out"});
  }
  if (!recording.pressure || recording.pressure->size() < 20) return;
  const auto& gauge = *recording.pressure;
  for (const auto& [k, end] : flat_runs(gauge.pressure_psi, quality.pressure)) {
    out.faults.push_back({"frozen", gauge.t_s[k], gauge.t_s[end - 1], end - k,
                          "pressure does not change at all for " + std::to_string(end - k) + " readings"});
  }
}

/// What a force depends on that nobody read is not known: the pressure is not what it was before or behind.
void leave_out_without_pressure(const messages::Recording& recording, Guarded& out) {
  const auto& t = recording.frame.t_s;
  for (const UnreadPressure& unread : unread_pressure(recording)) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < t.size(); ++k) {
      if (t[k] < unread.from_s || t[k] > unread.to_s) continue;
      out.usable[k] = false;
      ++count;
    }
    if (count == 0) continue;  // of the force there is none either, which is said already
    out.faults.push_back({"pressure", unread.from_s, unread.to_s, count,
                          "pressure.csv has no readings for " + in_four_digits(unread.to_s - unread.from_s) +
                              " s; the force meanwhile left out"});
  }
}

void find_gaps(const messages::FrameSamples& frame, Guarded& out) {
  const auto& t = frame.t_s;
  std::vector<double> steps;
  for (std::size_t k = 1; k < t.size(); ++k) steps.push_back(t[k] - t[k - 1]);
  if (steps.size() < 20) return;
  std::vector<double> sorted = steps;
  std::ranges::sort(sorted);
  const double longest_usual = sorted[sorted.size() * 99 / 100];
  for (std::size_t k = 0; k < steps.size(); ++k) {
    if (steps[k] > deciding().gap_ratio * longest_usual && is_gap(t, k))
      out.faults.push_back({"gap", t[k], t[k + 1], 0, "no readings for " + in_four_digits(steps[k]) + " s"});
  }
}

}  // namespace

Guarded guard_recording(const messages::Recording& recording, const RecordingQuality& quality) {
  Guarded out;
  const auto& frame = recording.frame;
  out.usable.assign(frame.size(), true);
  if (frame.size() < 20) return out;
  find_gaps(frame, out);
  leave_out_without_pressure(recording, out);
  find_frozen(recording, quality, out);
  find_outliers(frame, quality, out);
  find_position_outliers(frame, quality.position, out);
  const auto& [noise, step] = quality.force;
  if (step > deciding().coarse_step_noises * noise && step > 0.0)
    out.faults.push_back({"quantisation", frame.t_s.front(), frame.t_s.back(), frame.size(),
                          "force is read in steps of " + in_four_digits(step) + " N, coarser than its noise"});
  return out;
}

Guarded guard_recording(const messages::Recording& recording) {
  return guard_recording(recording, recording_quality(recording));
}

}  // namespace isorig::identify
