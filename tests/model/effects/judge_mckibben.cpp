// Second writings of the laws that muscles and dampers have: strain-dependent relaxation, damping by direction, the
// largest strain of the history, friction by load. Classical Runge-Kutta along the track, numerical integrals.
#include "judge_mckibben.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isorig::test {
namespace {

/// dz/dt = slope(z, x, v), z(0) = 0; `rate(x, v)` is how fast z may turn.
template <class Slope, class Rate>
Curve integrate_along(const Track& track, const Slope& slope, const Rate& rate) {
  constexpr double kShare = 0.02;  // of a turn per step: Runge-Kutta's error is its fifth power over 120
  Curve out{0.0};
  double z = 0.0;
  for (std::size_t i = 1; i < track.size(); ++i) {
    const double from_mm = track.position_mm[i - 1];
    const double v = (track.position_mm[i] - from_mm) / track.step_s;
    const auto parts = std::max(1L, std::lround(std::ceil(track.step_s * rate(from_mm, v) / kShare)));
    const double h = track.step_s / static_cast<double>(parts);
    for (long k = 0; k < parts; ++k) {
      const double x = from_mm + v * h * static_cast<double>(k), middle = x + 0.5 * v * h, end = x + v * h;
      const double k1 = slope(z, x, v), k2 = slope(z + 0.5 * h * k1, middle, v);
      const double k3 = slope(z + 0.5 * h * k2, middle, v), k4 = slope(z + h * k3, end, v);
      z += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
    }
    out.push_back(z);
  }
  return out;
}

Curve fung_arm(const Track& track, double tau_s, double b) {
  return integrate_along(
      track, [=](double z, double x, double v) { return std::exp(b * x) * v - z / tau_s; },
      [=](double, double v) { return 1.0 / tau_s + std::fabs(b * v); });
}

/// 2 / sqrt(pi) times the integral of exp(-u^2) from 0 to `to`, by Simpson's rule.
double error_integral(double to) {
  constexpr int kIntervals = 200;
  const double end = std::min(to, 7.0), h = end / kIntervals;
  double sum = 1.0 + std::exp(-end * end);
  for (int i = 1; i < kIntervals; ++i) sum += (i % 2 == 1 ? 4.0 : 2.0) * std::exp(-i * h * (i * h));
  return 2.0 * std::numbers::inv_sqrtpi * h / 3.0 * sum;
}

double elongation(const Track& track, std::size_t i) {
  return track.position_mm[i] + track.elongation_at_zero_mm;
}

/// `of(i, largest)` with the largest |elongation| up to each point.
template <class Of>
Columns by_largest_elongation(const Track& track, const Of& of) {
  Columns out(1);
  double largest = 0.0;
  for (std::size_t i = 0; i < track.size(); ++i) {
    if (const double now = std::fabs(elongation(track, i)); now > largest) largest = now;
    out[0].push_back(of(i, largest));
  }
  return out;
}

Judge set_by(std::function<double(Numbers, double beyond_mm)> lost) {
  return {.force = [lost](Numbers p, const Track& track) {
    Columns out(1);
    double beyond_mm = 0.0;
    for (const double x : track.position_mm) {
      if (x - track.position_mm.front() > beyond_mm) beyond_mm = x - track.position_mm.front();
      out[0].push_back(lost(p, beyond_mm));
    }
    return out;
  }};
}

/// Pressure of the gas in a braid behind a valve, over the measured one, times the muscle's pull for a psi. Angles
/// instead of lengths: a thread b at the angle a to the axis makes a cylinder b cos(a) long and sin(a) / n wide.
Curve gas(const Track& track, double tau_s, double angle_deg, double kappa, double rest_mm) {
  constexpr double kAtmosphere_psi = 14.696;
  const double thread_mm = rest_mm / std::cos(angle_deg * std::numbers::pi / 180.0);
  const auto angle = [=](double x) { return std::acos((rest_mm + x) / thread_mm); };
  // dV/V and dV for a millimetre: dx = -b sin(a) da.
  const auto share = [=](double x) {
    const double a = angle(x);
    return (std::tan(a) - 2.0 / std::tan(a)) / (thread_mm * std::sin(a));
  };
  const auto lever = [=](double x) { return std::pow(std::sin(angle(x)), 2.0) * std::cos(angle(x)) * share(x); };
  const double nominal_psi = track.nominal_pressure_psi + kAtmosphere_psi, lever_at_rest = lever(0.0);
  double inside_psi = nominal_psi + track.excess_psi.front();
  Curve out;
  for (std::size_t i = 0; i < track.size(); ++i) {
    if (i > 0) {
      const double from_mm = track.position_mm[i - 1], v = (track.position_mm[i] - from_mm) / track.step_s;
      const double from_psi = nominal_psi + track.excess_psi[i - 1];
      const double rise = (track.excess_psi[i] - track.excess_psi[i - 1]) / track.step_s;
      const auto slope = [&](double s, double p) {
        return -kappa * p * share(from_mm + v * s) * v + (from_psi + rise * s - p) / tau_s;
      };
      const auto parts = std::max(1L, std::lround(std::ceil(track.step_s / (0.05 * tau_s))));
      const double h = track.step_s / static_cast<double>(parts);
      for (long k = 0; k < parts; ++k) {
        const double s = h * static_cast<double>(k), p = inside_psi;
        const double k1 = slope(s, p), k2 = slope(s + 0.5 * h, p + 0.5 * h * k1);
        const double k3 = slope(s + 0.5 * h, p + 0.5 * h * k2), k4 = slope(s + h, p + h * k3);
        inside_psi += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
      }
    }
    out.push_back(lever(track.position_mm[i]) / lever_at_rest * (inside_psi - nominal_psi - track.excess_psi[i]));
  }
  return out;
}

}  // namespace

void add_mckibben(std::map<std::string, Judge>& of) {
  of["quasi_linear_viscoelasticity/fung_arm"] = {
      .force = [](Numbers p, const Track& t) { return Columns{fung_arm(t, p[0], p[1])}; }};
  of["quasi_linear_viscoelasticity/relaxation_time"] = {.force = [](Numbers p, const Track& t) {
    const double tau_s = p[0], b = p[1];
    return Columns{integrate_along(
        t, [=](double z, double x, double v) { return v - z / (tau_s * std::exp(b * x)); },
        [=](double x, double v) { return std::exp(-b * x) / tau_s + std::fabs(b * v); })};
  }};
  of["directional_damping/series"] = {.force = [](Numbers p, const Track& t) {
    const double lengthening_s = p[0], shortening_s = p[0] * p[1];
    // The slope bends at z = 0: steps of a tenth of a millisecond keep that below 1e-6.
    return Columns{integrate_along(
        t, [=](double z, double, double v) { return v - (z > 0.0 ? z / lengthening_s : z / shortening_s); },
        [=](double, double) { return std::fmax(200.0, 1.0 / std::fmin(lengthening_s, shortening_s)); })};
  }};
  of["directional_damping/parallel"] = {.force = [](Numbers, const Track& t) {
    Columns out(2, Curve(t.size(), 0.0));
    for (std::size_t i = 0; i < t.size(); ++i) out[t.velocity_mm_s[i] > 0.0 ? 0 : 1][i] = t.velocity_mm_s[i];
    return out;
  }};
  of["strain_stiffening/lock"] = {.force = [](Numbers p, const Track& t) {
    Columns out(1);
    // x^2 / (L - x): the same with its denominator cleared.
    for (const double x : t.position_mm) out[0].push_back(x * x / (p[0] - x));
    return out;
  }};
  of["mullins_softening/ogden_roxburgh"] = {.force = [](Numbers p, const Track& t) {
    return by_largest_elongation(t, [&](std::size_t i, double largest) {
      const double e = elongation(t, i);
      return e * error_integral((largest * largest - e * e) / (p[0] * p[0]));
    });
  }};
  of["mullins_softening/damage"] = {.force = [](Numbers p, const Track& t) {
    const double start = std::fabs(elongation(t, 0));
    return by_largest_elongation(t, [&](std::size_t i, double largest) {
      return elongation(t, i) * (1.0 - 1.0 / std::exp((largest - start) / p[0]));
    });
  }};
  of["permanent_set/proportional"] = set_by([](Numbers, double beyond_mm) { return beyond_mm; });
  of["permanent_set/yield"] =
      set_by([](Numbers p, double beyond_mm) { return beyond_mm > p[0] ? beyond_mm - p[0] : 0.0; });
  of["permanent_set/saturating"] =
      set_by([](Numbers p, double beyond_mm) { return 1.0 - 1.0 / std::exp(beyond_mm / p[0]); });
  of["trapped_gas/polytropic"] = {
      .force = [](Numbers p, const Track& t) { return Columns{gas(t, p[0], p[1], p[2], p[3])}; }};
  of["friction_with_load/capstan"] = {.shape = [](Numbers p, const Track& t, const Curve& force) {
    const double delta_mm = p[0];
    const Curve bristle = integrate_along(
        t, [=](double z, double, double v) { return (v - std::fabs(v) * z) / delta_mm; },
        [=](double, double v) { return std::fabs(v) / delta_mm; });
    Curve out = force;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] += p[1] * bristle[i] * force[i];
    return out;
  }};
}

}  // namespace isorig::test
