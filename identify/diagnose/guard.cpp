#include "identify/diagnose/guard.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "identify/diagnose/drive.hpp"

namespace isorig::identify {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

/// Readings that jump away from their neighbours and back: alone, or in a short run.
void find_outliers(const messages::FrameSamples& frame, Guarded& out) {
  const auto& t = frame.t_s;
  const auto& f = frame.force_N;
  const std::size_t n = f.size();
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  // Simulated force may have no noise at all: then only what stands out of its range can be a fault.
  const double noise =
      std::max({white_noise(t, f), quantisation(f) / std::sqrt(12.0), 1e-4 * (*high - *low), 1e-9});
  std::size_t count = 0;
  double first = 0.0, last = 0.0, largest = 0.0;
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
        if (!out.usable[j]) clear = false;
        const double near = f[j] - line(t[j], k - 1, k + run);
        const double wide = f[j] - line(t[j], k - 2, k + run + 1);
        for (const double d : {near, wide}) {
          least = std::min(least, d);
          most = std::max(most, d);
        }
      }
      if (!clear || !out.usable[k - 1] || !out.usable[k + run] || least * most <= 0.0) continue;
      const double size = std::min(std::fabs(least), std::fabs(most));
      // Neighbours must agree with each other: a corner of a ramp bends them too.
      const double left = std::fabs(f[k - 1] - line(t[k - 1], k - 2, k + run));
      const double right = std::fabs(f[k + run] - line(t[k + run], k - 1, k + run + 1));
      if (size < 8.0 * noise || size < 4.0 * std::max(left, right)) continue;
      for (std::size_t j = k; j < k + run; ++j) out.usable[j] = false;
      if (count == 0) first = t[k];
      first = std::min(first, t[k]);
      last = std::max(last, t[k]);
      largest = std::max(largest, std::max(std::fabs(least), std::fabs(most)));
      count += run;
    }
  }
  // Several close together hide each other from their neighbours, not from the median of nine. The limit
  // grows with the spread within the nine, so that steep motion is not taken for a fault.
  constexpr std::size_t kHalf = 4;
  std::array<double, 2 * kHalf + 1> near{};
  const auto middle = near.begin() + kHalf;
  for (std::size_t k = kHalf; k + kHalf < n; ++k) {
    if (!out.usable[k]) continue;
    for (std::size_t j = 0; j < near.size(); ++j) near[j] = f[k - kHalf + j];
    std::nth_element(near.begin(), middle, near.end());
    const double median = *middle, away = std::fabs(f[k] - median);
    if (away < 8.0 * noise) continue;
    for (std::size_t j = 0; j < near.size(); ++j) near[j] = std::fabs(f[k - kHalf + j] - median);
    std::nth_element(near.begin(), middle, near.end());
    if (away < 9.0 * *middle) continue;
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
                              number(largest) + " N; left out"});
}

/// Runs of one and the same value where the noise would have moved the reading. Calls found(first, end) for
/// each. A run that long comes once in a thousand recordings: a reading in the middle of its step repeats
/// itself with the probability erf(step / (2 sqrt(2) noise)), which for a fine step is nil and for one of
/// three noises is 0.87.
template <class Found>
void find_standing(const std::vector<double>& t, const std::vector<double>& reading, const Found& found) {
  constexpr double kShortest = 12.0, kPerRecording = 1e-3;
  const double step = quantisation(reading), measured = white_noise(t, reading);
  const double noise = std::sqrt(std::max(measured * measured - step * step / 12.0, 0.0));
  if (noise < 0.2 * step || measured <= 0.0) return;  // too coarse for a run to mean anything
  const double repeats = std::erf(step / (2.0 * std::sqrt(2.0) * noise));
  const double longest =
      repeats > 0.0 ? 1.0 + std::log(static_cast<double>(reading.size()) / kPerRecording) / -std::log(repeats)
                    : 0.0;
  const auto shortest = static_cast<std::size_t>(std::max(kShortest, std::ceil(longest)));
  for (std::size_t k = 0; k < reading.size();) {
    std::size_t end = k + 1;
    while (end < reading.size() && reading[end] == reading[k]) ++end;
    if (end - k >= shortest) found(k, end);
    k = end;
  }
}

void find_frozen(const messages::Recording& recording, Guarded& out) {
  const auto& t = recording.frame.t_s;
  const auto& f = recording.frame.force_N;
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  find_standing(t, f, [&](std::size_t k, std::size_t end) {
    const bool edge = f[k] == *low || f[k] == *high;
    for (std::size_t j = k; j < end; ++j) out.usable[j] = false;
    out.faults.push_back(
        {edge ? "saturation" : "frozen", t[k], t[end - 1], end - k,
         edge ? "force stands at the end of its range, " + number(f[k]) + " N; left out"
              : "force does not change at all for " + std::to_string(end - k) + " readings; left out"});
  });
  find_standing(t, recording.frame.position_mm, [&](std::size_t k, std::size_t end) {
    for (std::size_t j = k; j < end; ++j) out.usable[j] = false;
    out.faults.push_back({"frozen", t[k], t[end - 1], end - k,
                          "position does not change at all for " + std::to_string(end - k) +
                              " readings; the force meanwhile is left out"});
  });
  if (!recording.pressure || recording.pressure->size() < 20) return;
  const auto& gauge = *recording.pressure;
  find_standing(gauge.t_s, gauge.pressure_psi, [&](std::size_t k, std::size_t end) {
    out.faults.push_back({"frozen", gauge.t_s[k], gauge.t_s[end - 1], end - k,
                          "pressure does not change at all for " + std::to_string(end - k) + " readings"});
  });
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
    if (steps[k] > 8.0 * longest_usual)
      out.faults.push_back({"gap", t[k], t[k + 1], 0, "no readings for " + number(steps[k]) + " s"});
  }
}

}  // namespace

Guarded guard_recording(const messages::Recording& recording) {
  Guarded out;
  const auto& frame = recording.frame;
  out.usable.assign(frame.size(), true);
  if (frame.size() < 20) return out;
  find_gaps(frame, out);
  find_frozen(recording, out);
  find_outliers(frame, out);
  const double noise = white_noise(frame.t_s, frame.force_N);
  const double step = quantisation(frame.force_N);
  if (step > 1.5 * noise && step > 0.0)
    out.faults.push_back({"quantisation", frame.t_s.front(), frame.t_s.back(), frame.size(),
                          "force is read in steps of " + number(step) + " N, coarser than its noise"});
  return out;
}

}  // namespace isorig::identify
