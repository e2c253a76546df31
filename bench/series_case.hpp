#pragma once
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "model/force_velocity.hpp"

/// The record of docs/force-velocity.md, which benchmark and tests fit.
namespace isorig::bench {

struct SeriesCase {
  std::vector<double> t_s, x_mm, force_N;
};

/// At 1 kHz, in cycles of 80 s (up at 5, down at 0.1 and 10, up at 1 mm/s): 20 N and 2.5 N/mm, with arms
/// (1.5 N/mm, 6 s) and (0.8 N/mm, 0.5 s), and noise from `random`.
inline SeriesCase series_case(std::size_t samples, double noise_N, std::mt19937& random, bool second_arm = true) {
  constexpr double kInterval_s = 0.001;
  std::normal_distribution<double> unit;
  SeriesCase out;
  double x_mm = 0.0, slow_mm = 0.0, fast_mm = 0.0;
  for (std::size_t i = 0; i < samples; ++i) {
    const double t_s = kInterval_s * static_cast<double>(i), phase_s = std::fmod(t_s, 80.0);
    const double velocity_mm_s = phase_s > 10 && phase_s < 10.4   ? 5.0
                                 : phase_s > 40 && phase_s < 60   ? -0.1
                                 : phase_s > 65 && phase_s < 65.2 ? -10.0
                                 : phase_s > 70 && phase_s < 72   ? 1.0
                                                                  : 0.0;
    const double step_mm = i == 0 ? 0.0 : velocity_mm_s * kInterval_s;
    x_mm += step_mm;
    slow_mm = slow_mm * std::exp(-kInterval_s / 6.0) + step_mm * model::maxwell_ramp_share(kInterval_s / 6.0);
    fast_mm = fast_mm * std::exp(-kInterval_s / 0.5) + step_mm * model::maxwell_ramp_share(kInterval_s / 0.5);
    out.t_s.push_back(t_s);
    out.x_mm.push_back(x_mm);
    out.force_N.push_back(20.0 + 2.5 * x_mm + 1.5 * slow_mm + (second_arm ? 0.8 * fast_mm : 0.0) +
                          noise_N * unit(random));
  }
  return out;
}

}  // namespace isorig::bench
