#include "identify/diagnose/motion/reconstruction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "identify/diagnose/motion/band_limited_motion.hpp"
#include "identify/diagnose/motion/corner_motion.hpp"
#include "identify/diagnose/motion/pressure_reconstruction.hpp"
#include "identify/diagnose/signal/flat_line.hpp"
#include "identify/diagnose/signal/noise_level.hpp"
#include "identify/diagnose/signal/spikes.hpp"

namespace isorig::identify {
namespace {

/// One pass of filter and smoother with acceleration variances `spread` per interval. The acceleration acts
/// as an impulse at the interval's end, so that the motion is straight between readings: a smoother motion
/// cannot follow a corner between two sparse readings without ringing, and friction would see every swing.
class AccelerationSmoother {
 public:
  AccelerationSmoother(std::span<const double> t_s, std::span<const double> reading_mm)
      : t_s_(t_s), y_(reading_mm), filtered_(t_s.size()), smoothed_(t_s.size()) {}

  struct State {
    double x = 0.0, v = 0.0;
    double pxx = 0.0, pxv = 0.0, pvv = 0.0;
  };

  /// Log-likelihood of every reading given those before it.
  void score(std::span<const double> spread, double noise_mm2, std::vector<double>& log_likelihood) {
    State s{y_[0], 0.0, 1e6 * noise_mm2 + 1e-6 * (1.0 + std::fabs(y_[0])) * (1.0 + std::fabs(y_[0])), 0.0, 1e4};
    update(s, y_[0], noise_mm2);
    log_likelihood[0] = 0.0;
    for (std::size_t k = 1; k < t_s_.size(); ++k) {
      s = predict(s, t_s_[k] - t_s_[k - 1], spread[k - 1]);
      const double total = s.pxx + noise_mm2, e = y_[k] - s.x;
      log_likelihood[k] = -0.5 * (e * e / total + std::log(total));
      update(s, y_[k], noise_mm2);
    }
  }

  /// Fills mean and variance of the acceleration of every interval.
  void run(std::span<const double> spread, double noise_mm2, std::vector<double>& mean, std::vector<double>& variance) {
    const std::size_t n = t_s_.size();
    const double range = 1.0 + std::fabs(y_[0]);
    State s{y_[0], 0.0, 1e6 * noise_mm2 + 1e-6 * range * range, 0.0, 1e4};
    update(s, y_[0], noise_mm2);
    filtered_[0] = s;
    for (std::size_t k = 1; k < n; ++k) {
      s = predict(s, t_s_[k] - t_s_[k - 1], spread[k - 1]);
      update(s, y_[k], noise_mm2);
      filtered_[k] = s;
    }
    smoothed_[n - 1] = s;
    for (std::size_t k = n - 1; k-- > 0;) {
      const double h = t_s_[k + 1] - t_s_[k];
      const State& f = filtered_[k];
      const State p = predict(f, h, spread[k]);
      const State& next = smoothed_[k + 1];
      const double det = std::fmax(p.pxx * p.pvv - p.pxv * p.pxv, 1e-300);
      const double dx = next.x - p.x, dv = next.v - p.v;
      // inv(P-) * d and inv(P-) (Ps - P-) inv(P-), for state and acceleration alike.
      const double ix = (p.pvv * dx - p.pxv * dv) / det, iv = (p.pxx * dv - p.pxv * dx) / det;
      const double dxx = next.pxx - p.pxx, dxv = next.pxv - p.pxv, dvv = next.pvv - p.pvv;
      const double axx = (p.pvv * dxx - p.pxv * dxv) / det, axv = (p.pvv * dxv - p.pxv * dvv) / det;
      const double avx = (p.pxx * dxv - p.pxv * dxx) / det, avv = (p.pxx * dvv - p.pxv * dxv) / det;
      const double mxx = (axx * p.pvv - axv * p.pxv) / det, mxv = (axv * p.pxx - axx * p.pxv) / det;
      const double mvv = (avv * p.pxx - avx * p.pxv) / det;
      // Cross covariances of (x, v) and of the acceleration with the predicted state.
      const double cxx = f.pxx + h * f.pxv, cxv = f.pxv, cvx = f.pxv + h * f.pvv, cvv = f.pvv;
      State& out = smoothed_[k];
      out.x = f.x + cxx * ix + cxv * iv;
      out.v = f.v + cvx * ix + cvv * iv;
      out.pxx = f.pxx + quadratic(cxx, cxv, cxx, cxv, mxx, mxv, mvv);
      out.pxv = f.pxv + quadratic(cxx, cxv, cvx, cvv, mxx, mxv, mvv);
      out.pvv = f.pvv + quadratic(cvx, cvv, cvx, cvv, mxx, mxv, mvv);
      const double av = spread[k] * h;
      mean[k] = av * iv;
      variance[k] = std::clamp(spread[k] + av * mvv * av, 0.0, spread[k]);
    }
  }

  [[nodiscard]] const std::vector<State>& states() const noexcept { return smoothed_; }

 private:
  static double quadratic(double a0, double a1, double b0, double b1, double mxx, double mxv, double mvv) {
    return a0 * (mxx * b0 + mxv * b1) + a1 * (mxv * b0 + mvv * b1);
  }
  static State predict(const State& s, double h, double spread) {
    State p;
    p.x = s.x + h * s.v;
    p.v = s.v;
    p.pxx = s.pxx + 2.0 * h * s.pxv + h * h * s.pvv;
    p.pxv = s.pxv + h * s.pvv;
    p.pvv = s.pvv + h * h * spread;
    // A trace of each keeps the prediction invertible when an interval has no acceleration of its own.
    p.pxx *= 1.0 + 1e-9;
    p.pvv *= 1.0 + 1e-9;
    return p;
  }
  static void update(State& s, double y, double noise_mm2) {
    const double total = s.pxx + noise_mm2;
    const double kx = s.pxx / total, kv = s.pxv / total;
    const double e = y - s.x;
    s.x += kx * e;
    s.v += kv * e;
    const double pxx = s.pxx * noise_mm2 / total;
    s.pvv -= kv * s.pxv;
    s.pxv *= noise_mm2 / total;
    s.pxx = pxx;
  }

  std::span<const double> t_s_;
  std::span<const double> y_;
  std::vector<State> filtered_, smoothed_;
};

/// The same path with every reversal smaller than `least_mm` taken out: monotone from one true turning point
/// to the next, which keep their place.
std::vector<double> without_small_reversals(const std::vector<double>& path, double least_mm) {
  std::vector<std::size_t> turns{0};
  std::size_t low = 0, high = 0;
  int direction = 0;
  for (std::size_t k = 1; k < path.size(); ++k) {
    if (path[k] > path[high]) high = k;
    if (path[k] < path[low]) low = k;
    if (direction >= 0 && path[high] - path[k] > least_mm) {
      turns.push_back(high);
      direction = -1;
      low = k;
      high = k;
    } else if (direction <= 0 && path[k] - path[low] > least_mm) {
      turns.push_back(low);
      direction = 1;
      low = k;
      high = k;
    }
    // Moving on in the same direction: the other extreme starts anew from here.
    if (direction > 0 && high == k) low = k;
    if (direction < 0 && low == k) high = k;
  }
  turns.push_back(path.empty() ? 0 : path.size() - 1);
  std::vector<double> out = path;
  for (std::size_t t = 0; t + 1 < turns.size(); ++t) {
    const double from = path[turns[t]], to = path[turns[t + 1]];
    const double least = std::min(from, to), most = std::max(from, to);
    double at = from;
    for (std::size_t k = turns[t]; k <= turns[t + 1]; ++k) {
      at = std::clamp(to >= from ? std::max(at, path[k]) : std::min(at, path[k]), least, most);
      out[k] = at;
    }
  }
  return out;
}

/// Seconds since the motion last changed its velocity by more than its noise allows; 0 while it does.
std::vector<double> since_corner(std::span<const double> t_s, const Motion& motion) {
  const std::size_t n = t_s.size();
  std::vector<double> since(n, 0.0);
  const double noise = std::max(motion.noise_mm, motion.quantisation_mm);
  double last_s = n > 0 ? t_s[0] - 10.0 : 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t from = k >= 2 ? k - 2 : 0, to = std::min(k + 2, n - 1);
    double change = 0.0;
    for (std::size_t j = std::max<std::size_t>(from, 1); j <= to; ++j)
      change += std::fabs(motion.acceleration_mm_s2[j]) * (t_s[j] - t_s[j - 1]);
    const double reach = change * (t_s[to] - t_s[from]);
    if (reach > 4.0 * noise) last_s = t_s[k];
    since[k] = t_s[k] - last_s;
  }
  return since;
}

/// Share of the time in which the velocity changes.
double busy_share(std::span<const double> t_s, std::span<const double> since) {
  double busy_s = 0.0;
  for (std::size_t k = 1; k < t_s.size(); ++k)
    if (since[k] < 3.0 * (t_s[k] - t_s[k - 1])) busy_s += t_s[k] - t_s[k - 1];
  return t_s.size() > 1 ? busy_s / (t_s.back() - t_s.front()) : 0.0;
}

}  // namespace

Motion smooth_motion(std::span<const double> t_s, std::span<const double> reading_mm) {
  const std::size_t n = t_s.size();
  Motion motion;
  if (n < 3) {
    motion.position_mm.assign(reading_mm.begin(), reading_mm.end());
    motion.velocity_mm_s.assign(n, 0.0);
    motion.acceleration_mm_s2.assign(n, 0.0);
    return motion;
  }
  const auto [low, high] = std::minmax_element(reading_mm.begin(), reading_mm.end());
  const double step = quantisation(reading_mm);
  // A staircase wider than the noise hides it; its error is uniform within a step.
  double noise = std::max({white_noise(t_s, reading_mm), step / std::sqrt(12.0), 1e-7 * (*high - *low), 1e-12});
  motion.quantisation_mm = step;

  AccelerationSmoother smoother(t_s, reading_mm);
  std::vector<double> spread(n - 1), mean(n - 1), variance(n - 1), next(n - 1);
  for (std::size_t k = 0; k + 1 < n; ++k) {
    const double h = t_s[k + 1] - t_s[k];
    const double bound = 3.0 * (noise + std::fabs(reading_mm[k + 1] - reading_mm[k])) / (h * h);
    spread[k] = std::min(bound * bound, 1e8);
  }
  constexpr double kStill = 1e-14, kAlive = 1e-7, kTogether_s = 0.012;
  const auto refine = [&](int passes) {
    for (int pass = 0; pass < passes; ++pass) {
      smoother.run(spread, noise * noise, mean, variance);
      // Accelerations of a machine last some 10 ms: neighbours within that time share their variance, so that
      // a corner that was sampled densely is found as a whole and one lucky reading is not.
      for (std::size_t k = 0; k + 1 < n; ++k) {
        if (spread[k] <= kStill) {
          next[k] = kStill;
          continue;
        }
        double energy = 0.0, known = 0.0;
        const std::size_t from = k >= 2 ? k - 2 : 0, to = std::min(k + 2, n - 2);
        for (std::size_t j = from; j <= to; ++j) {
          if (std::fabs(t_s[j] - t_s[k]) > kTogether_s) continue;
          const double weight = j == k ? 1.0 : 0.6;
          energy += weight * mean[j] * mean[j];
          known += weight * std::max(1.0 - variance[j] / spread[j], 1e-3);
        }
        next[k] = std::clamp(energy / known, kStill, 1e10);
      }
      spread.swap(next);
    }
  };
  refine(30);
  // Evidence alone lets some of 30 000 lucky readings through. A run of accelerations stays only if the
  // readings after it are explained clearly better with it: e^kWorth times, which is once in a long session.
  constexpr double kWorth = 9.0;
  std::vector<double> with(n), without(n);
  const auto prune = [&](std::size_t apart) {
    struct Run {
      std::size_t first, last;
    };
    std::vector<Run> runs;
    for (std::size_t k = 0; k + 1 < n; ++k) {
      if (spread[k] <= kAlive) continue;
      // Runs that nearly touch are judged as one at first, then apart.
      if (!runs.empty() && k - runs.back().last <= apart)
        runs.back().last = k;
      else
        runs.push_back({k, k});
    }
    smoother.score(spread, noise * noise, with);
    // Every other run at a time: what is taken out must not spoil what follows its neighbour.
    for (std::size_t parity = 0; parity < 2; ++parity) {
      std::vector<double> trial = spread;
      for (std::size_t r = parity; r < runs.size(); r += 2)
        for (std::size_t k = runs[r].first; k <= runs[r].last; ++k) trial[k] = kStill;
      smoother.score(trial, noise * noise, without);
      for (std::size_t r = parity; r < runs.size(); r += 2) {
        const std::size_t end = r + 1 < runs.size() ? runs[r + 1].first + 1 : n;
        double gain = 0.0;
        for (std::size_t k = runs[r].first + 1; k < end; ++k) gain += with[k] - without[k];
        if (gain >= kWorth) continue;
        for (std::size_t k = runs[r].first; k <= runs[r].last; ++k) spread[k] = kStill;
      }
    }
    refine(6);
  };
  prune(3);
  prune(3);
  // Where that went too far the readings leave the line together: open it again, wider.
  for (int round = 0; round < 3; ++round) {
    smoother.run(spread, noise * noise, mean, variance);
    std::vector<double> sum(n + 1, 0.0);
    for (std::size_t k = 0; k < n; ++k) sum[k + 1] = sum[k] + (reading_mm[k] - smoother.states()[k].x) / noise;
    bool opened = false;
    for (const std::size_t width : {4u, 8u, 16u, 48u}) {
      for (std::size_t k = 0; k + width <= n; ++k) {
        if (std::fabs(sum[k + width] - sum[k]) < 5.0 * std::sqrt(static_cast<double>(width))) continue;
        const std::size_t from = k > width / 2 + 2 ? k - width / 2 - 2 : 0;
        for (std::size_t j = from; j < std::min(k + width + width / 2 + 2, n - 1); ++j) {
          const double h = t_s[j + 1] - t_s[j];
          spread[j] = std::max(spread[j], 4.0 * noise * noise / (h * h * h * h));
        }
        opened = true;
      }
    }
    if (!opened) break;
    refine(20);
    prune(3);
  }
  for (double& value : spread)
    if (value <= kAlive) value = kStill;
  smoother.run(spread, noise * noise, mean, variance);
  motion.position_mm.resize(n);
  motion.velocity_mm_s.resize(n);
  motion.acceleration_mm_s2.resize(n);
  double squares = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    motion.position_mm[k] = smoother.states()[k].x;
    // At a reading: the mean of what was before and what comes after.
    const double after = smoother.states()[k].v, before = k > 0 ? smoother.states()[k - 1].v : after;
    motion.velocity_mm_s[k] = 0.5 * (before + after);
    if (k > 0 && k + 1 < n) motion.acceleration_mm_s2[k] = (after - before) / (0.5 * (t_s[k + 1] - t_s[k - 1]));
    const double e = reading_mm[k] - motion.position_mm[k];
    squares += e * e;
  }
  motion.noise_mm = std::sqrt(squares / static_cast<double>(n));
  return motion;
}

Excitation reconstruct_excitation(const messages::Recording& recording) {
  Excitation excitation;
  const auto& frame = recording.frame;
  const std::size_t n = frame.size();
  const std::vector<double> reading_mm =
      without_flat_runs(frame.t_s, without_spikes(frame.t_s, frame.position_mm).reading_mm);
  excitation.motion = smooth_motion(frame.t_s, reading_mm);
  excitation.since_corner_s = since_corner(frame.t_s, excitation.motion);
  constexpr double kBusy = 0.5;
  if (busy_share(frame.t_s, excitation.since_corner_s) > kBusy) {
    if (auto busy = band_limited_motion(frame.t_s, reading_mm)) {
      excitation.motion = std::move(busy->motion);
      excitation.width = busy->width;
    }
  }
  if (excitation.width == 1) smooth_corners(frame.t_s, reading_mm, excitation.motion);
  const auto& metadata = recording.metadata;
  excitation.reference.elongation_at_zero_mm =
      metadata.pressurized_rest_length_mm ? metadata.rest_length_mm - *metadata.pressurized_rest_length_mm : 0.0;
  excitation.reference.duration_s = n > 0 ? frame.t_s.back() - frame.t_s.front() : 0.0;

  if (recording.pressure && recording.pressure->size() > 0) {
    ReconstructedPressure pressure =
        reconstruct_pressure(*recording.pressure, frame.t_s, excitation.motion.position_mm);
    excitation.pressure_psi = std::move(pressure.pressure_psi);
    excitation.pressure_noise_psi = pressure.noise_psi;
    excitation.pressure_clock_s = pressure.clock_s;
    excitation.pressure_clock_error_s = pressure.clock_error_s;
  }
  double nominal = metadata.nominal_pressure_psi.value_or(0.0);
  if (!metadata.nominal_pressure_psi && !excitation.pressure_psi.empty()) {
    for (const double p : excitation.pressure_psi) nominal += p / static_cast<double>(n);
  }
  excitation.reference.nominal_pressure_psi = nominal;

  excitation.instants.resize(n);
  excitation.slid_mm = without_small_reversals(
      excitation.motion.position_mm, 5.0 * std::max(excitation.motion.noise_mm, excitation.motion.quantisation_mm));
  for (std::size_t k = 0; k < n; ++k) {
    model::Instant& now = excitation.instants[k];
    now.t_s = frame.t_s[k];
    now.position_mm = excitation.motion.position_mm[k];
    now.elongation_mm = now.position_mm + excitation.reference.elongation_at_zero_mm;
    if (k > 0) {
      now.dt_s = now.t_s - frame.t_s[k - 1];
      now.step_mm = now.position_mm - excitation.motion.position_mm[k - 1];
      now.slide_mm = excitation.slid_mm[k] - excitation.slid_mm[k - 1];
    }
    now.velocity_mm_s = excitation.motion.velocity_mm_s[k];
    now.acceleration_mm_s2 = excitation.motion.acceleration_mm_s2[k];
    now.excess_pressure_psi = excitation.pressure_psi.empty() ? 0.0 : excitation.pressure_psi[k] - nominal;
  }
  return excitation;
}

}  // namespace isorig::identify
