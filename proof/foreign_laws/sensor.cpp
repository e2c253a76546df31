#include <numbers>

#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {
namespace {

/// N equal poles in a row, all settled at the start.
template <std::size_t N>
Signal poles(const Drive& drive, const Signal& force_N, double lag_s) {
  const double each_s = lag_s / static_cast<double>(N);
  std::array<double, N> settled;
  settled.fill(force_N.front());
  Signal out(force_N.size());
  integrate<N>(
      drive, settled,
      [&](const std::array<double, N>& y, std::size_t i, double part) {
        std::array<double, N> rate{};
        double entering = within(force_N, i, part);
        for (std::size_t n = 0; n < N; ++n) {
          rate[n] = (entering - y[n]) / each_s;
          entering = y[n];
        }
        return rate;
      },
      [&](std::size_t i, const std::array<double, N>& y) { out[i] = y[N - 1]; });
  return out;
}

/// A signal at earlier times: straight between nodes, constant before the first.
class Past {
 public:
  Past(const Signal& t_s, const Signal& value) : t_s_(t_s), value_(value) {}
  /// `near` is a node at or after t_s.
  [[nodiscard]] double at(double t_s, std::size_t near) const noexcept {
    while (near > 0 && t_s_[near] > t_s) --near;
    if (t_s <= t_s_[0]) return value_[0];
    if (near + 1 >= t_s_.size()) return value_.back();
    const double part = (t_s - t_s_[near]) / (t_s_[near + 1] - t_s_[near]);
    return value_[near] + part * (value_[near + 1] - value_[near]);
  }

 private:
  const Signal& t_s_;
  const Signal& value_;
};

}  // namespace

Signal two_pole(const Drive& drive, const Signal& force_N, double lag_s) {
  return poles<2>(drive, force_N, lag_s);
}

Signal four_pole(const Drive& drive, const Signal& force_N, double lag_s) {
  return poles<4>(drive, force_N, lag_s);
}

Signal hann_filter(const Signal& t_s, const Signal& force_N, double delay_s) {
  constexpr std::size_t kTaps = 24;
  std::array<double, kTaps> weight{}, age_s{};
  for (std::size_t n = 0; n < kTaps; ++n) {
    const double phase = (static_cast<double>(n) + 0.5) / kTaps;
    age_s[n] = 2.0 * delay_s * phase;
    weight[n] = (1.0 - std::cos(2.0 * std::numbers::pi * phase)) / kTaps;  // the cosines sum to zero
  }
  const Past past(t_s, force_N);
  Signal out(force_N.size(), 0.0);
  for (std::size_t i = 0; i < out.size(); ++i)
    for (std::size_t n = 0; n < kTaps; ++n) out[i] += weight[n] * past.at(t_s[i] - age_s[n], i);
  return out;
}

Signal beating_delay(const Signal& t_s, const Signal& force_N, double delay_s, double depth, double period_s) {
  const Past past(t_s, force_N);
  Signal out(force_N.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double phase = t_s[i] / period_s - std::floor(t_s[i] / period_s);
    out[i] = past.at(t_s[i] - delay_s * (1.0 + depth * (2.0 * phase - 1.0)), i);
  }
  return out;
}

Signal sprung_mass(const Drive& drive, double mass_kg, double frequency_Hz, double damping) {
  const double omega = 2.0 * std::numbers::pi * frequency_Hz;
  Signal force(drive.size());
  integrate<2>(
      drive, {0.0, 0.0},
      [&](const std::array<double, 2>& y, std::size_t i, double part) {
        const double driving = within(drive.acceleration_mm_s2, i, part);
        return std::array{y[1], omega * omega * (driving - y[0]) - 2.0 * damping * omega * y[1]};
      },
      [&](std::size_t i, const std::array<double, 2>& y) { force[i] = 1e-3 * mass_kg * y[0]; });
  return force;
}

Signal two_masses(const Drive& drive, double mass_kg, double frequency_Hz, double damping) {
  Signal force = sprung_mass(drive, 0.5 * mass_kg, frequency_Hz, damping);
  for (std::size_t i = 0; i < force.size(); ++i) force[i] += 1e-3 * 0.5 * mass_kg * drive.acceleration_mm_s2[i];
  return force;
}

Signal growing_mass(const Drive& drive, double mass_kg, double length_mm) {
  Signal force(drive.size());
  for (std::size_t i = 0; i < force.size(); ++i) {
    const double v = drive.velocity_mm_s[i];
    force[i] =
        1e-3 * mass_kg * ((1.0 + drive.position_mm[i] / length_mm) * drive.acceleration_mm_s2[i] + v * v / length_mm);
  }
  return force;
}

double hyperbolic_slack_N(double force_N, double width_N) {
  return 0.5 * (force_N + std::hypot(force_N, width_N));
}

double bimodular_N(double force_N, double share) {
  return force_N < 0.0 ? share * force_N : force_N;
}

double saturated_N(double force_N, double ceiling_N, double width_N) {
  return 0.5 * (force_N + ceiling_N - std::hypot(force_N - ceiling_N, width_N));
}

Signal cell_hysteresis(const Signal& force_N, double share, double span_N) {
  constexpr std::size_t kPlays = 8;
  Signal out = force_N;
  for (std::size_t n = 0; n < kPlays; ++n) {
    const double half_N = 0.5 * span_N * (static_cast<double>(n) + 1.0) / kPlays;
    double at_N = force_N.front();
    for (std::size_t i = 0; i < force_N.size(); ++i) {
      at_N = std::clamp(at_N, force_N[i] - half_N, force_N[i] + half_N);
      out[i] += share / kPlays * (at_N - force_N[i]);
    }
  }
  return out;
}

}  // namespace isorig::proof::foreign
