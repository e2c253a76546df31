#include "identify/diagnose/motion/pressure_reconstruction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "model/stepping.hpp"

namespace isorig::identify {

// A random walk x with noise, readings y_k of variance r, walk of variance w^2 a second (the local level model: Harvey
// 1989, ch. 2):
//
//     P^-_k = P_k-1 + w^2 dt,   S = P^-_k + r,   e = y_k - x_k-1,   x_k = x_k-1 + P^-_k / S e,   P_k = P^-_k r / S
//     ln L = -1/2 sum (e^2 / S + ln S)
//     x^s_k = x_k + P_k / P^-_k+1 (x^s_k+1 - x_k)
//
// r and w by maximum likelihood on a grid: noise 0.6 to 1.15 of the robust estimate, walk half a decade apart.
SlowSignal smooth_slow(std::span<const double> t_s, std::span<const double> reading, const ChannelQuality& quality) {
  const std::size_t n = t_s.size();
  SlowSignal out;
  out.value.assign(reading.begin(), reading.end());
  if (n < 8) return out;
  std::vector<double> filtered(n), p_filtered(n), p_predicted(n);
  const auto run = [&](double noise2, double walk2_s) {
    double x = reading[0], p = 100.0 * noise2 + 1e-12, log_likelihood = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      if (k > 0) p += walk2_s * (t_s[k] - t_s[k - 1]);
      p_predicted[k] = p;
      const double total = p + noise2, e = reading[k] - x;
      log_likelihood -= 0.5 * (e * e / total + std::log(total));
      x += p / total * e;
      p *= noise2 / total;
      filtered[k] = x;
      p_filtered[k] = p;
    }
    return log_likelihood;
  };
  const double white = std::max({quality.noise, quality.rounding(), 1e-12});
  double best = -std::numeric_limits<double>::infinity(), best_noise = white, best_walk = white;
  for (const double scale : {0.6, 0.75, 0.9, 1.0, 1.15}) {
    for (int i = -7; i <= 4; ++i) {
      const double noise = scale * white, walk = white * std::pow(10.0, 0.5 * i);
      const double value = run(noise * noise, walk * walk);
      if (value > best) {
        best = value;
        best_noise = noise;
        best_walk = walk;
      }
    }
  }
  run(best_noise * best_noise, best_walk * best_walk);
  out.value[n - 1] = filtered[n - 1];
  for (std::size_t k = n - 1; k-- > 0;)
    out.value[k] = filtered[k] + p_filtered[k] / p_predicted[k + 1] * (out.value[k + 1] - filtered[k]);
  out.noise = best_noise;
  out.walk = best_walk;
  return out;
}

namespace {

/// Straight between its points, constant beyond the ends; `at` moves on with increasing times.
class Line {
 public:
  Line(std::span<const double> t_s, std::span<const double> value) : t_s_(t_s), value_(value) {}
  double operator()(double t_s) noexcept {
    while (at_ > 0 && t_s_[at_] > t_s) --at_;
    while (at_ + 1 < t_s_.size() && t_s_[at_ + 1] <= t_s) ++at_;
    if (at_ + 1 >= t_s_.size() || t_s <= t_s_[at_]) return value_[at_];
    const double share = (t_s - t_s_[at_]) / (t_s_[at_ + 1] - t_s_[at_]);
    return value_[at_] + share * (value_[at_ + 1] - value_[at_]);
  }

 private:
  std::span<const double> t_s_;
  std::span<const double> value_;
  std::size_t at_ = 0;
};

/// A tenth of the intervals is shorter.
double usual_interval_s(std::span<const double> t_s) {
  if (t_s.size() < 3) return 0.0;
  std::vector<double> steps;
  for (std::size_t k = 1; k < t_s.size(); ++k) steps.push_back(t_s[k] - t_s[k - 1]);
  return base::quantile(std::move(steps), 0.1);
}

/// p(t) = slow(t) + h z(t - clock), dz/dt = dx/dt - z / tau: the motion x through a first-order high-pass (tau: the
/// recovery of the regulator, h: its droop in psi/mm).
class Response {
 public:
  Response(const messages::PressureSamples& gauge, std::span<const double> t_s, std::span<const double> position_mm)
      : gauge_(gauge), t_s_(t_s), position_mm_(position_mm), column_(t_s.size()) {}

  /// The motion through the high-pass, per row of the frame.
  const std::vector<double>& column(double recovery_s) {
    if (recovery_s == recovery_s_) return column_;
    recovery_s_ = recovery_s;
    model::MaxwellState state(recovery_s);
    column_[0] = 0.0;
    for (std::size_t k = 1; k < t_s_.size(); ++k)
      column_[k] = state.step(position_mm_[k] - position_mm_[k - 1], t_s_[k] - t_s_[k - 1]);
    return column_;
  }

  struct Score {
    double gain = 0.0;  ///< log-likelihood gained over no response
    double droop_psi_mm = 0.0;
  };
  /// The filter of smooth_slow() over the readings (innovations e_p) and over the column z (e_z) alike. By generalised
  /// least squares h = sum e_p e_z / S / sum e_z^2 / S, and it gains (sum e_p e_z / S)^2 / (2 sum e_z^2 / S) in ln L.
  Score score(double recovery_s, double clock_s, double noise_psi, double walk_psi) {
    Line line(t_s_, column(recovery_s));
    double x = gauge_.pressure_psi[0], y = 0.0, p = 100.0 * noise_psi * noise_psi + 1e-12;
    double xy = 0.0, yy = 0.0;
    for (std::size_t k = 0; k < gauge_.size(); ++k) {
      const double column = line(gauge_.t_s[k] - clock_s);
      if (k == 0)
        y = column;
      else
        p += walk_psi * walk_psi * (gauge_.t_s[k] - gauge_.t_s[k - 1]);
      const double total = p + noise_psi * noise_psi, gain = p / total;
      const double ex = gauge_.pressure_psi[k] - x, ey = column - y;
      xy += ex * ey / total;
      yy += ey * ey / total;
      x += gain * ex;
      y += gain * ey;
      p *= noise_psi * noise_psi / total;
    }
    if (yy <= 0.0) return {};
    return {0.5 * xy * xy / yy, xy / yy};
  }

 private:
  const messages::PressureSamples& gauge_;
  std::span<const double> t_s_;
  std::span<const double> position_mm_;
  std::vector<double> column_;
  double recovery_s_ = -1.0;
};

}  // namespace

ReconstructedPressure reconstruct_pressure(const messages::PressureSamples& gauge, const ChannelQuality& quality,
                                           std::span<const double> t_s, std::span<const double> position_mm) {
  ReconstructedPressure out;
  std::vector<double> rest = gauge.pressure_psi;
  SlowSignal slow = smooth_slow(gauge.t_s, rest, quality);
  constexpr std::size_t kFewest = 50;
  // A gauge read as often as the frame needs no help, and is on the same clock.
  const bool sparse = usual_interval_s(gauge.t_s) > deciding().sparse_gauge_ratio * usual_interval_s(t_s);
  const double worth = deciding().pressure_response_nats, largest_clock_s = deciding().largest_pressure_clock_s;
  if (sparse && gauge.size() >= kFewest && t_s.size() >= kFewest) {
    Response response(gauge, t_s, position_mm);
    double recovery_s = 1.0, clock_s = 0.0;
    Response::Score best;
    for (int round = 0; round < 3; ++round) {
      const double noise = std::max(slow.noise, 1e-12), walk = slow.walk;
      best = {};
      const auto try_at = [&](double tau, double clock) {
        const auto trial = response.score(tau, clock, noise, walk);
        if (trial.gain <= best.gain) return;
        best = trial;
        recovery_s = tau;
        clock_s = clock;
      };
      if (round == 0) {
        for (double tau = 0.08; tau < 200.0; tau *= 2.2)
          for (const double clock : {-0.3, 0.0, 0.3}) try_at(tau, clock);
      } else {
        try_at(recovery_s, clock_s);
      }
      for (double width = round == 0 ? 1.0 : 0.25; width > 0.01; width *= 0.5) {
        const double tau = recovery_s, clock = clock_s;
        for (const double move : {-1.0, 1.0}) try_at(tau * std::exp(0.7 * move * width), clock);
        for (const double move : {-0.5, -0.25, 0.25, 0.5})
          try_at(recovery_s, std::clamp(clock + move * width, -largest_clock_s, largest_clock_s));
      }
      if (best.gain < worth) break;
      Line line(t_s, response.column(recovery_s));
      for (std::size_t k = 0; k < rest.size(); ++k)
        rest[k] = gauge.pressure_psi[k] - best.droop_psi_mm * line(gauge.t_s[k] - clock_s);
      slow = smooth_slow(gauge.t_s, rest, channel_quality(gauge.t_s, rest));
    }
    if (best.gain >= worth) {
      out.droop_psi_mm = best.droop_psi_mm;
      out.recovery_s = recovery_s;
      const double noise = std::max(slow.noise, 1e-12);
      const double without = response.score(recovery_s, 0.0, noise, slow.walk).gain;
      const double at = response.score(recovery_s, clock_s, noise, slow.walk).gain;
      constexpr double kStep_s = 0.01;
      const double bend = 2.0 * at - response.score(recovery_s, clock_s - kStep_s, noise, slow.walk).gain -
                          response.score(recovery_s, clock_s + kStep_s, noise, slow.walk).gain;
      // Curvature of ln L by the clock: -(L(c + d) - 2 L(c) + L(c - d)) / d^2 is one over the variance.
      if (bend > 0.0) out.clock_error_s = 1.96 * kStep_s / std::sqrt(bend);
      if (at - without >= deciding().pressure_clock_nats && out.clock_error_s > 0.0) {
        out.clock_s = clock_s;
      } else {
        // The clocks agree as far as can be told: then they do.
        out.droop_psi_mm = response.score(recovery_s, 0.0, noise, slow.walk).droop_psi_mm;
        Line line(t_s, response.column(recovery_s));
        for (std::size_t k = 0; k < rest.size(); ++k)
          rest[k] = gauge.pressure_psi[k] - out.droop_psi_mm * line(gauge.t_s[k]);
        slow = smooth_slow(gauge.t_s, rest, channel_quality(gauge.t_s, rest));
      }
    } else {
      slow = smooth_slow(gauge.t_s, gauge.pressure_psi, quality);
    }
    if (out.droop_psi_mm != 0.0) (void)response.column(out.recovery_s);
    Line line(gauge.t_s, slow.value);
    out.pressure_psi.resize(t_s.size());
    for (std::size_t k = 0; k < t_s.size(); ++k) {
      out.pressure_psi[k] = line(t_s[k] + out.clock_s);
      if (out.droop_psi_mm != 0.0) out.pressure_psi[k] += out.droop_psi_mm * response.column(out.recovery_s)[k];
    }
  } else {
    Line line(gauge.t_s, slow.value);
    for (const double t : t_s) out.pressure_psi.push_back(line(t));
  }
  out.noise_psi = slow.noise;
  return out;
}

}  // namespace isorig::identify
