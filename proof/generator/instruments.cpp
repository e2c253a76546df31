#include "proof/generator/instruments.hpp"

#include <cmath>
#include <numbers>

namespace isorig::proof {
namespace {

double rounded(double value, double step) {
  return std::round(value / step) * step;
}

/// First-order coloured noise at the given times.
std::vector<double> coloured(const std::vector<double>& t_s, const Instruments& in, Random& random) {
  std::vector<double> noise(t_s.size(), 0.0);
  double state = in.coloured_noise_N * random.normal();
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    const double forgotten = in.coloured_readings > 0.0 ? 1.0 / in.coloured_readings
                             : i == 0                   ? 0.0
                                                        : (t_s[i] - t_s[i - 1]) / in.coloured_time_s;
    const double keep = std::exp(-forgotten);
    state = keep * state + in.coloured_noise_N * std::sqrt(1.0 - keep * keep) * random.normal();
    noise[i] = state;
  }
  return noise;
}

std::vector<bool> lost_rows(const std::vector<double>& t_s, int gaps, Random& random) {
  std::vector<bool> lost(t_s.size(), false);
  for (int gap = 0; gap < gaps; ++gap) {
    const double start_s = random.uniform(0.05, 0.95) * t_s.back();
    const double end_s = start_s + random.uniform(1.0, 6.0);
    for (std::size_t i = 0; i < t_s.size(); ++i) lost[i] = lost[i] || (t_s[i] > start_s && t_s[i] < end_s);
  }
  return lost;
}

}  // namespace

MadeRecording measure(const Trace& trace, const Instruments& in, double duration_s,
                      messages::RecordingMetadata metadata, Random& random) {
  std::vector<double> noise_N(trace.t_s.size(), 0.0);
  if (in.coloured_noise_N > 0.0) noise_N = coloured(trace.t_s, in, random);
  for (std::size_t i = 0; i < noise_N.size(); ++i)
    noise_N[i] += in.force_noise_N * (1.0 + in.warming * trace.t_s[i] / duration_s) * random.normal();
  for (int n = 0; n < in.outliers; ++n)
    noise_N[random.index(noise_N.size())] += random.sign() * in.outlier_N * random.log_uniform(0.5, 5.0);
  const std::vector<bool> lost = lost_rows(trace.t_s, in.gaps, random);
  for (std::size_t i = 0; i < noise_N.size(); ++i)
    noise_N[i] += in.hum_N * std::sin(2.0 * std::numbers::pi * in.mains_Hz * trace.t_s[i]);

  MadeRecording made;
  messages::Recording& r = made.recording;
  r.metadata = std::move(metadata);
  r.metadata.rest_length_mm = rounded(*r.metadata.rest_length_mm, 1e-3);
  r.metadata.pressurized_rest_length_mm = rounded(*r.metadata.pressurized_rest_length_mm, 1e-3);
  for (std::size_t i = 0; i < trace.t_s.size(); ++i) {
    const double position_noise_mm = in.position_noise_mm * random.normal();
    if (lost[i]) continue;
    r.frame.t_s.push_back(rounded(trace.t_s[i], 1e-6));
    r.frame.position_mm.push_back(rounded(trace.position_mm[i] + position_noise_mm, in.position_step_mm));
    r.frame.force_N.push_back(rounded(trace.force_N[i] + noise_N[i], in.force_step_N));
    made.truth_N.push_back(trace.force_N[i]);
  }
  if (!in.pressure_recorded) return made;
  messages::PressureSamples pressure;
  for (std::size_t i = 0; i < trace.pressure_t_s.size(); ++i) {
    const double t_s = trace.pressure_t_s[i] + in.pressure_clock_s;
    const double noise_psi = in.pressure_noise_psi * random.normal();
    if (t_s < 0.0) continue;
    pressure.t_s.push_back(rounded(t_s, 1e-6));
    pressure.pressure_psi.push_back(rounded(trace.pressure_psi[i] + noise_psi, in.pressure_step_psi));
  }
  r.pressure = std::move(pressure);
  return made;
}

}  // namespace isorig::proof
