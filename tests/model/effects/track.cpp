#include "track.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace isorig::test {
namespace {

void stroke(Track& track, double to_mm, double seconds) {
  const double from_mm = track.position_mm.back();
  const auto count = static_cast<std::size_t>(std::lround(seconds / track.step_s));
  for (std::size_t i = 1; i <= count; ++i) {
    track.position_mm.push_back(from_mm + (to_mm - from_mm) * static_cast<double>(i) / static_cast<double>(count));
    track.velocity_mm_s.push_back((to_mm - from_mm) / seconds);
  }
}

Track at_rest() {
  Track track;
  track.position_mm.push_back(0.0);
  track.velocity_mm_s.push_back(0.0);
  return track;
}

void press(Track& track) {
  for (std::size_t i = 0; i < track.size(); ++i)
    track.excess_psi.push_back(0.3 * std::sin(0.9 * track.t_s(i)) + 0.1 * std::sin(2.3 * track.t_s(i) + 1.0));
}

}  // namespace

double Track::acceleration_mm_s2(std::size_t i) const {
  i = std::clamp<std::size_t>(i, 1, size() - 2);
  return (position_mm[i + 1] - 2.0 * position_mm[i] + position_mm[i - 1]) / (step_s * step_s);
}

Strokes strokes() {
  Strokes out{at_rest()};
  Track& track = out.track;
  track.elongation_at_zero_mm = 0.7;
  stroke(track, 0.0, 0.5);
  stroke(track, 2.0, 0.5);
  stroke(track, 2.0, 3.0);
  stroke(track, -1.0, 1.5);
  stroke(track, -1.0, 2.0);
  for (const double size_mm : {0.3, 0.05, 0.02}) {
    stroke(track, -1.0 + size_mm, 0.2);
    stroke(track, -1.0, 0.1);
    stroke(track, -1.0 + 0.5 * size_mm, 0.1);
  }
  stroke(track, 1.5, 0.3);
  stroke(track, -1.5, 5.0);
  stroke(track, 0.0, 0.7);
  stroke(track, 0.0, 2.0);
  press(track);
  return out;
}

Track smooth_track() {
  Track track;
  track.step_s = 2e-4;
  track.elongation_at_zero_mm = 0.7;
  const double w1 = 2.0 * std::numbers::pi * 0.23, w2 = 2.0 * std::numbers::pi * 0.71;
  const auto count = static_cast<std::size_t>(16.0 / track.step_s);
  for (std::size_t i = 0; i <= count; ++i) {
    const double t = track.t_s(i);
    track.position_mm.push_back(1.2 * std::sin(w1 * t) + 0.5 * (std::sin(w2 * t + 0.4) - std::sin(0.4)));
    track.velocity_mm_s.push_back(1.2 * w1 * std::cos(w1 * t) + 0.5 * w2 * std::cos(w2 * t + 0.4));
  }
  press(track);
  return track;
}

Track closed_track(unsigned seed) {
  std::mt19937 random(seed);
  const auto between = [&random](double low, double high) {  // even in the logarithm
    return low * std::pow(high / low, std::uniform_real_distribution<double>()(random));
  };
  Track track = at_rest();
  track.elongation_at_zero_mm = 0.7;
  for (int i = 0; i < 40; ++i) {
    const double sign = random() % 2 == 0 ? 1.0 : -1.0;
    double to_mm = track.position_mm.back() + sign * between(0.01, 2.0);
    if (std::fabs(to_mm) > 2.0) to_mm = 0.0;
    if (i == 39) to_mm = 0.0;
    const double length_mm = std::fabs(to_mm - track.position_mm.back());
    stroke(track, to_mm, std::fmax(0.002, std::ceil(1e3 * length_mm / between(0.1, 10.0)) * 1e-3));
  }
  track.excess_psi.assign(track.size(), 0.0);
  return track;
}

Track faster(Track track, double factor) {
  track.step_s /= factor;
  for (double& v : track.velocity_mm_s) v *= factor;
  return track;
}

std::vector<double> model_force(const model::ModelSpec& spec, const Track& track, std::span<const std::size_t> rows) {
  model::Reference reference;
  reference.elongation_at_zero_mm = track.elongation_at_zero_mm;
  reference.nominal_pressure_psi = track.nominal_pressure_psi;
  reference.duration_s = track.t_s(track.size() - 1);
  reference.recording_id = kTrackId;
  model::RunningModel running(spec, reference);
  std::vector<double> force_N;
  model::Instant now;
  std::size_t last = 0;
  for (const std::size_t i : rows) {
    now.t_s = track.t_s(i);
    now.dt_s = track.t_s(i) - track.t_s(last);
    now.position_mm = track.position_mm[i];
    now.elongation_mm = track.position_mm[i] + track.elongation_at_zero_mm;
    now.step_mm = track.position_mm[i] - track.position_mm[last];
    now.velocity_mm_s = track.velocity_mm_s[i];
    now.acceleration_mm_s2 = track.acceleration_mm_s2(i);
    now.excess_pressure_psi = track.excess_psi[i];
    if (force_N.empty()) running.reset(now);
    force_N.push_back(running.step(now));
    last = i;
  }
  return force_N;
}

std::vector<std::size_t> every(const Track& track, std::size_t stride) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < track.size(); i += stride) rows.push_back(i);
  return rows;
}

}  // namespace isorig::test
