#pragma once
#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {

/// Signals of an analytic motion on an even grid of 1 ms.
template <class Position, class Velocity>
Drive driven(double duration_s, const Position& position_mm, const Velocity& velocity_mm_s, double step_s = 1e-3) {
  Drive d;
  const auto count = static_cast<int>(std::lround(duration_s / step_s));
  for (int n = 0; n <= count; ++n) {
    const double t = n * step_s;
    d.t_s.push_back(t);
    d.position_mm.push_back(position_mm(t));
    d.velocity_mm_s.push_back(velocity_mm_s(t));
  }
  d.acceleration_mm_s2.assign(d.size(), 0.0);
  d.pressure_psi.assign(d.size(), 15.0);
  d.elastic_N.assign(d.size(), 10.0);
  d.specimen_N.assign(d.size(), 10.0);
  return d;
}

inline Drive ramp(double velocity_mm_s, double duration_s) {
  return driven(
      duration_s, [=](double t) { return velocity_mm_s * t; }, [=](double) { return velocity_mm_s; });
}

inline Drive sine(double amplitude_mm, double frequency_Hz, int cycles) {
  const double omega = 2.0 * 3.141592653589793 * frequency_Hz;
  Drive d = driven(
      cycles / frequency_Hz, [=](double t) { return amplitude_mm * std::sin(omega * t); },
      [=](double t) { return amplitude_mm * omega * std::cos(omega * t); });
  for (std::size_t i = 0; i < d.size(); ++i) d.acceleration_mm_s2[i] = -omega * omega * d.position_mm[i];
  return d;
}

/// Work done on the element over the last cycle of a periodic motion (trapezoidal rule).
inline double work_of_last_cycle(const Drive& d, const Signal& force_N, double frequency_Hz) {
  double work = 0.0;
  for (std::size_t i = 1; i < d.size(); ++i)
    if (d.t_s[i] > d.t_s.back() - 1.0 / frequency_Hz + 1e-9)
      work += 0.5 * (force_N[i] + force_N[i - 1]) * (d.position_mm[i] - d.position_mm[i - 1]);
  return work;
}

}  // namespace isorig::proof::foreign
