#include "identify/diagnose/guard/guard.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/number_text.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/guard/gaps.hpp"
#include "identify/diagnose/signal/flat_line.hpp"
#include "identify/diagnose/signal/spikes.hpp"

namespace isorig::identify {
namespace {

std::string in_four_digits(double value) {
  return base::number_text(value, 4);
}

void find_outliers(const messages::FrameSamples& frame, const ChannelQuality& quality, Guarded& out) {
  const auto& t = frame.t_s;
  const auto& f = frame.force_N;
  const std::size_t n = f.size();
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  // Simulated force may have no noise at all: then only what stands out of its range can be a fault.
  const double noise = std::max({quality.noise, quality.rounding(), 1e-4 * (*high - *low), 1e-9});
  const Spikes spikes = find_spikes(t, f, noise, out.usable);
  std::size_t count = spikes.rows.size();
  double first = count > 0 ? t[spikes.rows.front()] : 0.0, last = count > 0 ? t[spikes.rows.back()] : 0.0;
  double largest = spikes.largest;
  // Several close together hide each other from their neighbours, not from the median of nine. The limit
  // grows with the spread within the nine, so that steep motion is not taken for a fault.
  constexpr std::size_t kHalf = 4;
  std::array<double, 2 * kHalf + 1> near{};
  for (std::size_t k = kHalf; k + kHalf < n; ++k) {
    if (!out.usable[k]) continue;
    for (std::size_t j = 0; j < near.size(); ++j) near[j] = f[k - kHalf + j];
    const double median = base::quantile_in_place(near, 0.5), away = std::fabs(f[k] - median);
    if (away < deciding().outlier_noises * noise) continue;
    for (std::size_t j = 0; j < near.size(); ++j) near[j] = std::fabs(f[k - kHalf + j] - median);
    if (away < deciding().outlier_ratio * base::quantile_in_place(near, 0.5)) continue;
    out.usable[k] = false;
    first = count == 0 ? t[k] : std::min(first, t[k]);
    last = std::max(last, t[k]);
    largest = std::max(largest, away);
    ++count;
  }
  if (count > 0)
    out.faults.push_back({"outliers", first, last, count,
                          std::to_string(count) +
                              " force readings jump away from their neighbours and back, by up to " +
                              in_four_digits(largest) + " N; left out"});
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
  find_frozen(recording, quality, out);
  find_outliers(frame, quality.force, out);
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
