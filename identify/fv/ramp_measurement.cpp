#include "identify/fv/ramp_measurement.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

namespace isorig::identify {
namespace {

std::size_t index_at(std::span<const double> t_s, double t) {  // first sample at or after t
  return static_cast<std::size_t>(std::lower_bound(t_s.begin(), t_s.end(), t) - t_s.begin());
}

/// When the position first reaches its target: the crossing, less what noise would cross early by. A
/// crosshead that creeps into its target without overshoot has reached it within max(3 sigma, 0.1 % of the
/// stroke).
std::optional<double> arrival_s(const RampChannels& c, const Move& m) {
  const double d = m.stroke_mm() > 0 ? 1.0 : -1.0;
  const double margin = std::max(3.0 * c.sigma_x_mm, 1e-3 * std::abs(m.stroke_mm()));
  const double speed = std::abs(m.velocity_mm_s.value);
  std::size_t i = index_at(c.t_s, m.t_start_s + 0.5 * (m.t_end_s - m.t_start_s));
  // In slow ramps many samples lie within the noise of the target: look through a line over the samples of
  // one noise width (local least squares), so that the first of many noisy samples is not taken for arrival.
  const double half_s =
      std::isfinite(speed) && speed > 0 ? std::min(4.0 * c.sigma_x_mm / speed, 0.05 * (m.t_end_s - m.t_start_s)) : 0.0;
  double previous_t = kNaN, previous_off = kNaN;
  // The end of the creep lies within the noise of the hold, so after the last sample that counts as motion.
  const double latest_s = c.t_s[m.last] + std::max(0.5, m.t_end_s - m.t_start_s);
  for (; i < c.t_s.size() && c.t_s[i] <= latest_s; ++i) {
    double x = c.x_mm[i];
    std::size_t a = i, b = i;
    while (a > m.first && c.t_s[i] - c.t_s[a - 1] <= half_s) --a;
    while (b + 1 < c.t_s.size() && c.t_s[b + 1] - c.t_s[i] <= half_s) ++b;
    if (b - a >= 4) x = fit_line(c.t_s.subspan(a, b - a + 1), c.x_mm.subspan(a, b - a + 1)).at(c.t_s[i]);
    const double off = d * (x - m.to_mm) + margin;
    if (off >= 0.0) {
      double t = c.t_s[i];
      if (std::isfinite(previous_off)) t = previous_t - previous_off / (off - previous_off) * (c.t_s[i] - previous_t);
      // The crossing of the target itself lies the margin further, at the ramp's speed; never past the next
      // sample.
      if (i + 1 < c.t_s.size() && speed > 0 && d * (c.x_mm[i + 1] - m.to_mm) > 0.0)
        t = std::min(t + margin / speed, c.t_s[i + 1]);
      return t;
    }
    previous_t = c.t_s[i];
    previous_off = off;
  }
  return std::nullopt;
}

/// Share of the ramp during which the local speed is within 5 % of its highest: 8 slices, each its own line.
double plateau_share(const RampChannels& c, const Move& m, double t_peak_s) {
  const std::size_t a = index_at(c.t_s, m.t_start_s), b = index_at(c.t_s, t_peak_s);
  if (b < a + 12) return kNaN;
  const std::size_t slices = std::min<std::size_t>(8, (b - a) / 3);
  std::vector<Line> lines;
  double top = 0.0;
  for (std::size_t k = 0; k < slices; ++k) {
    const std::size_t i = a + k * (b - a) / slices, j = a + (k + 1) * (b - a) / slices;
    lines.push_back(fit_line(c.t_s.subspan(i, j - i), c.x_mm.subspan(i, j - i)));
    const double span_s = c.t_s[j - 1] - c.t_s[i];
    // The error of a slope over n samples of known noise; the residual of so few says little.
    lines.back().se_slope = c.sigma_x_mm * std::sqrt(12.0 / static_cast<double>(j - i)) / span_s;
  }
  std::vector<double> speeds;
  speeds.reserve(lines.size());
  for (const Line& l : lines) speeds.push_back(std::abs(l.slope));
  std::sort(speeds.begin(), speeds.end());
  top = speeds[speeds.size() - 2];  // the second highest: one slice may hold a disturbance
  std::size_t longest = 0, run = 0;
  for (const Line& l : lines) {
    run = std::abs(l.slope) >= 0.95 * top - 3.0 * l.se_slope ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  return static_cast<double>(longest) / static_cast<double>(slices);
}

/// The force at the target where few samples lie near it: a parabola of force against position through the last six on
/// the ramp, read at the target. A sample behind the target has relaxed already, and a line between the last one before
/// and the first one behind it was 2 to 7 % of the viscous height too low. The force of an arm bends exponentially;
/// what a parabola leaves of that is estimated by the cubic term, and is part of the error.
std::optional<Estimate> force_at_target_of_few(const RampChannels& c, const Move& m, std::size_t end) {
  constexpr std::size_t kMost = 6, kFewest = 4;
  const double d = m.stroke_mm() > 0 ? 1.0 : -1.0, stroke_mm = std::abs(m.stroke_mm());
  const double margin_mm = std::max(4.0 * c.sigma_x_mm, 1e-3 * stroke_mm);
  const auto short_mm = [&](std::size_t k) { return d * (m.to_mm - c.x_mm[k]); };
  while (end > m.first && short_mm(end - 1) < margin_mm) --end;
  std::size_t first = end;
  while (first > m.first && end - first < kMost && short_mm(first - 1) < 0.75 * stroke_mm) --first;
  const std::size_t n = end - first;
  if (n < kFewest) return std::nullopt;
  // Powers of the way to the target, so that the first coefficient is the force there.
  Eigen::MatrixXd powers(static_cast<Eigen::Index>(n), 4);
  Eigen::VectorXd force_N(static_cast<Eigen::Index>(n));
  for (std::size_t i = 0; i < n; ++i) {
    const double u = short_mm(first + i) / short_mm(first);
    powers.row(static_cast<Eigen::Index>(i)) << 1.0, u, u * u, u * u * u;
    force_N[static_cast<Eigen::Index>(i)] = c.force_N[first + i];
  }
  const auto at_target = [&](Eigen::Index terms) {
    return powers.leftCols(terms).colPivHouseholderQr().solve(force_N)[0];
  };
  const Eigen::MatrixXd parabola = powers.leftCols(3);
  const double noise_N = c.sigma_force_N * std::sqrt((parabola.transpose() * parabola).inverse()(0, 0));
  const double value_N = at_target(3);
  // With as many terms as samples the cubic follows the noise; half of its difference is no more than that then.
  return Estimate{value_N, std::hypot(noise_N, 0.5 * (at_target(4) - value_N))};
}

/// The force at the target: a line of force against position over the last stretch before arrival, read at
/// the target. Position, not time, so that the slowing down of the crosshead does not bend it.
std::optional<Estimate> force_at_target(const RampChannels& c, const Move& m, double t_peak_s) {
  const std::size_t end = index_at(c.t_s, t_peak_s);
  if (end == 0 || end >= c.t_s.size()) return std::nullopt;
  const double d = m.stroke_mm() > 0 ? 1.0 : -1.0;
  // 15 % of the stroke when samples are few, down to 3 % when they are many: the bend of an SLS ramp over 15
  // % puts the end of a line off by less than 0.0007 of the viscous height.
  const std::size_t mid = index_at(c.t_s, 0.5 * (m.t_start_s + m.t_end_s));
  const double inside = static_cast<double>(end > mid ? 2 * (end - mid) : 1);
  const double share = std::clamp(20.0 / inside, 0.03, 0.15);
  std::size_t a = end;
  while (a > m.first && d * (m.to_mm - c.x_mm[a - 1]) < share * std::abs(m.stroke_mm())) --a;
  if (end - a >= 4) {
    Line line = fit_line(c.x_mm.subspan(a, end - a), c.force_N.subspan(a, end - a));
    const double spread_mm = std::abs(c.x_mm[end - 1] - c.x_mm[a]);
    if (spread_mm > 5.0 * c.sigma_x_mm && line.residual_sd > 2.0 * c.sigma_force_N) {
      // Few samples show the bend of the curve, and are too few to know the moment of arrival by.
      constexpr std::size_t kFew = 8;
      if (end - a < kFew) return force_at_target_of_few(c, m, end);
      // The force is no line of position here (a crosshead that creeps in lets the arm relax meanwhile): the
      // last samples against time instead, which is noisier.
      const std::size_t first = std::max(a, end - std::min<std::size_t>(end - a, 6));
      const Line last = fit_line(c.t_s.subspan(first, end - first), c.force_N.subspan(first, end - first));
      const double n = static_cast<double>(end - first);
      return Estimate{last.at(t_peak_s), std::max(last.se_at(t_peak_s), 2.0 * c.sigma_force_N / std::sqrt(n))};
    }
    if (spread_mm > 5.0 * c.sigma_x_mm) {
      // Few samples estimate their own scatter badly: never less than the noise of the channel.
      if (line.residual_sd < c.sigma_force_N) {
        const double scale = c.sigma_force_N / std::max(line.residual_sd, 1e-300);
        line.se_mean *= scale;
        line.se_slope *= scale;
      }
      return Estimate{line.at(m.to_mm), line.se_at(m.to_mm)};
    }
    return Estimate{line.mean, std::max(line.se_mean, c.sigma_force_N / std::sqrt(static_cast<double>(end - a)))};
  }
  // If the samples belong to the end of this ramp.
  if (c.t_s[end] - c.t_s[end - 1] > 0.15 * (m.t_end_s - m.t_start_s)) return std::nullopt;
  return force_at_target_of_few(c, m, end);
}

void pressure_of(const messages::Recording& recording, const RampOptions& options, double rest_end_s, Ramp& ramp) {
  if (!recording.pressure) return;
  const auto& p = *recording.pressure;
  const std::size_t a = index_at(p.t_s, rest_end_s - options.rest_window_s), b = index_at(p.t_s, rest_end_s);
  if (b <= a) return;
  double sum = 0.0;
  for (std::size_t i = a; i < b; ++i) sum += p.pressure_psi[i];
  ramp.pressure_before_psi = sum / static_cast<double>(b - a);
  if (!ramp.t_peak_s) return;
  const std::size_t at = index_at(p.t_s, *ramp.t_peak_s);
  if (at == 0 || at >= p.t_s.size() || p.t_s[at] - p.t_s[at - 1] > 0.5) return;
  const double w = (*ramp.t_peak_s - p.t_s[at - 1]) / (p.t_s[at] - p.t_s[at - 1]);
  ramp.pressure_change_psi = (1.0 - w) * p.pressure_psi[at - 1] + w * p.pressure_psi[at] - *ramp.pressure_before_psi;
}

/// F0, its drift, and where rest ended. Returns the window's end.
double start_force(const RampChannels& c, const RampOptions& options, Ramp& ramp) {
  const Move& m = ramp.move;
  const double guard_mm = std::max(4.0 * c.sigma_x_mm, 1e-3 * std::abs(m.stroke_mm()));
  // Motion begins before the fitted corner (the crosshead accelerates): walk back to where it is still at
  // rest.
  std::size_t end = index_at(c.t_s, m.t_start_s + 0.25 * (m.t_end_s - m.t_start_s));
  end = std::min(end, c.t_s.size() - 1);
  while (end > 0 && std::abs(c.x_mm[end] - m.from_mm) > guard_mm) --end;
  while (end > 0 && c.t_s[end] > m.t_start_s) --end;
  std::size_t begin = end;
  while (begin > 0 && c.t_s[begin - 1] >= c.t_s[end] - options.rest_window_s &&
         std::abs(c.x_mm[begin - 1] - m.from_mm) < 2.0 * guard_mm)
    --begin;
  const double rest_s = c.t_s[end] - c.t_s[begin];
  const std::size_t n = end - begin + 1;
  if (rest_s < options.shortest_hold_s || n < 5) {
    ramp.flags.push_back(RampFlag::kNoRestBefore);
    return c.t_s[end];
  }
  const double spacing_s = rest_s / static_cast<double>(n - 1);
  if (rest_s + 2.0 * spacing_s < 0.9 * options.rest_window_s) ramp.flags.push_back(RampFlag::kShortRest);
  for (std::size_t i = begin; i <= end; ++i)
    if (c.clipped[i]) {
      ramp.flags.push_back(RampFlag::kForceClipped);
      return c.t_s[end];
    }
  const Line line = fit_line(c.t_s.subspan(begin, n), c.force_N.subspan(begin, n));
  // The line at the middle of the window is the mean over the window's time; the mean of the samples would be
  // that of its densely sampled end.
  const double middle_s = 0.5 * (c.t_s[begin] + c.t_s[end]);
  ramp.start_force_N = Estimate{line.at(middle_s), line.se_at(middle_s)};
  ramp.drift_N_s = Estimate{line.slope, line.se_slope};
  const double carried_N = std::abs(line.slope) * (0.5 * rest_s + (m.t_end_s - m.t_start_s));
  if (std::abs(line.slope) > 4.0 * line.se_slope && carried_N > 1e-3 * std::abs(ramp.start_force_N->value))
    ramp.flags.push_back(RampFlag::kUnsteadyStart);
  return c.t_s[end];
}

void normalise(const RampChannels& c, Ramp& ramp) {
  const auto& meta = c.recording.metadata;
  const Move& m = ramp.move;
  const double length_mm = meta.reference_length_mm();
  if (length_mm > 0.0 && std::isfinite(m.velocity_mm_s.value)) {
    ramp.strain_rate_per_s = Estimate{m.velocity_mm_s.value / length_mm, m.velocity_mm_s.standard_error / length_mm};
    ramp.strain_step = m.stroke_mm() / length_mm;
    ramp.initial_strain = meta.strain(m.from_mm);
  }
  if (!ramp.start_force_N || !ramp.peak_force_N) return;
  const Estimate f0 = *ramp.start_force_N, peak = *ramp.peak_force_N;
  // 3 % at one standard error: what makes the normalised force uncertain by more than the curve is high.
  if (f0.value <= 0.0 || f0.value < 30.0 * std::max(f0.standard_error, 0.0) || f0.value < 0.01 * std::abs(peak.value)) {
    ramp.flags.push_back(RampFlag::kForceNotPositive);
    return;
  }
  const double ratio = peak.value / f0.value;
  ramp.normalized_force = Estimate{ratio, std::hypot(peak.standard_error, ratio * f0.standard_error) / f0.value};
}

}  // namespace

Ramp measure_ramp(const RampChannels& c, const Move& m, const RampOptions& options, bool hold_after) {
  Ramp ramp;
  ramp.move = m;
  ramp.plateau_share = kNaN;
  const double rest_end_s = start_force(c, options, ramp);
  if (!std::isfinite(m.velocity_mm_s.value)) ramp.flags.push_back(RampFlag::kTooFewSamples);
  if (!hold_after) {
    ramp.flags.push_back(RampFlag::kNoHoldAfter);
  } else {
    ramp.t_peak_s = arrival_s(c, m);
  }
  if (ramp.t_peak_s) {
    ramp.plateau_share = plateau_share(c, m, *ramp.t_peak_s);
    if (ramp.plateau_share < 0.3) ramp.flags.push_back(RampFlag::kNeverReachedSpeed);
    const std::size_t at = index_at(c.t_s, *ramp.t_peak_s);
    const double d = m.stroke_mm() > 0 ? 1.0 : -1.0;
    double beyond = 0.0;
    const double settle_s = *ramp.t_peak_s + std::max(1.0, m.t_end_s - m.t_start_s);
    for (std::size_t i = at; i < c.t_s.size() && c.t_s[i] < settle_s; ++i)
      beyond = std::max(beyond, d * (c.x_mm[i] - m.to_mm));
    ramp.overshoot_mm = beyond;
    if (beyond > std::max(6.0 * c.sigma_x_mm, 5e-3 * std::abs(m.stroke_mm())))
      ramp.flags.push_back(RampFlag::kOvershot);
    bool clipped = false;
    for (std::size_t i = index_at(c.t_s, m.t_start_s); i <= at && i < c.clipped.size(); ++i)
      clipped = clipped || c.clipped[i] != 0;
    if (clipped) {
      if (!ramp.has(RampFlag::kForceClipped)) ramp.flags.push_back(RampFlag::kForceClipped);
    } else {
      ramp.peak_force_N = force_at_target(c, m, *ramp.t_peak_s);
      if (!ramp.peak_force_N)
        ramp.flags.push_back(RampFlag::kGapAtPeak);
      else if (m.stroke_mm() < 0.0 &&
               std::abs(ramp.peak_force_N->value) < 4.0 * std::max(ramp.peak_force_N->standard_error, c.sigma_force_N))
        ramp.flags.push_back(RampFlag::kWentSlack);
    }
  }
  normalise(c, ramp);
  pressure_of(c.recording, options, rest_end_s, ramp);
  return ramp;
}

}  // namespace isorig::identify
