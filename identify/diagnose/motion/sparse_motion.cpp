#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/motion/reconstruction.hpp"

namespace isorig::identify {
namespace {

/// One pass of filter and smoother (Kalman 1960; Rauch, Tung & Striebel 1965) over
///
///     x_k+1 = x_k + h v_k,   v_k+1 = v_k + h a_k,   a_k ~ N(0, spread_k),   reading_k = x_k + noise
///
/// The acceleration acts as an impulse at the interval's end, so that the motion is straight between readings: a
/// smoother motion cannot follow a corner between two sparse readings without ringing, and friction would see every
/// swing. Given all readings, with ^- predicted, ^s smoothed and M = (P^-)^-1 (P^s - P^-) (P^-)^-1,
///
///     E[a_k] = spread_k h [(P^-)^-1 (x^s - x^-)]_v,   var a_k = spread_k + (spread_k h)^2 M_vv
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

/// The search for the accelerations that the readings demand, in stages: refine, prune, open again.
class SparseMotion {
 public:
  SparseMotion(std::span<const double> t_s, std::span<const double> reading_mm, double noise_mm,
               const MotionProgress& on_progress)
      : t_s_(t_s),
        reading_mm_(reading_mm),
        noise_mm_(noise_mm),
        on_progress_(on_progress),
        smoother_(t_s, reading_mm),
        spread_(t_s.size() - 1),
        mean_(t_s.size() - 1),
        variance_(t_s.size() - 1),
        next_(t_s.size() - 1),
        with_(t_s.size()),
        without_(t_s.size()) {
    // At first every interval may hold what its two readings could mean at most.
    for (std::size_t k = 0; k < spread_.size(); ++k) {
      const double h = t_s_[k + 1] - t_s_[k];
      const double bound = 3.0 * (noise_mm_ + std::fabs(reading_mm_[k + 1] - reading_mm_[k])) / (h * h);
      spread_[k] = std::min(bound * bound, 1e8);
    }
  }

  [[nodiscard]] const std::vector<AccelerationSmoother::State>& search() {
    refine(kFirst);
    // Runs of accelerations that nearly touch are judged as one at first, then apart.
    prune(3);
    prune(3);
    for (int round = 0; round < kRounds && open_again(); ++round) {
      refine(kAgain);
      prune(3);
    }
    for (double& value : spread_)
      if (value <= kAlive) value = kStill;
    smooth();
    return smoother_.states();
  }
  /// After search(): of each reading given those before it.
  [[nodiscard]] const std::vector<double>& log_likelihood() {
    smoother_.score(spread_, noise_mm_ * noise_mm_, with_);
    return with_;
  }
  [[nodiscard]] bool turns(std::size_t interval) const { return spread_[interval] > kStill; }

 private:
  static constexpr double kStill = 1e-14, kAlive = 1e-7;  // (mm/s^2)^2

  static constexpr int kFirst = 30, kRounds = 3, kAgain = 20, kPruned = 6;  // passes of the smoother
  /// All there may be: the last rounds are not always needed, and what is left then goes by in a jump.
  static constexpr int kMost = kFirst + 2 * kPruned + kRounds * (1 + kAgain + kPruned) + 2;

  void smooth() {
    smoother_.run(spread_, noise_mm_ * noise_mm_, mean_, variance_);
    ++passes_;
    if (on_progress_) on_progress_(static_cast<double>(passes_) / kMost);
  }

  /// MacKay's fixed point: the variance s of an acceleration becomes mean^2 / (1 - variance / s), where both are those
  /// that the smoother gives it (MacKay 1992; Tipping 2001). Accelerations of a machine last some 10 ms: neighbours
  /// within that time share their variance, so that a corner that was sampled densely is found as a whole and one
  /// lucky reading is not.
  void refine(int passes) {
    const std::size_t n = t_s_.size();
    for (int pass = 0; pass < passes; ++pass) {
      smooth();
      for (std::size_t k = 0; k + 1 < n; ++k) {
        if (spread_[k] <= kStill) {
          next_[k] = kStill;
          continue;
        }
        double energy = 0.0, known = 0.0;
        const std::size_t from = k >= 2 ? k - 2 : 0, to = std::min(k + 2, n - 2);
        for (std::size_t j = from; j <= to; ++j) {
          if (std::fabs(t_s_[j] - t_s_[k]) > deciding().accelerates_together_s) continue;
          const double weight = j == k ? 1.0 : 0.6;
          energy += weight * mean_[j] * mean_[j];
          known += weight * std::max(1.0 - variance_[j] / spread_[j], 1e-3);
        }
        next_[k] = std::clamp(energy / known, kStill, 1e10);
      }
      spread_.swap(next_);
    }
  }

  struct Run {
    std::size_t first, last;
  };
  [[nodiscard]] std::vector<Run> alive(std::size_t apart) const {
    std::vector<Run> runs;
    for (std::size_t k = 0; k < spread_.size(); ++k) {
      if (spread_[k] <= kAlive) continue;
      if (!runs.empty() && k - runs.back().last <= apart)
        runs.back().last = k;
      else
        runs.push_back({k, k});
    }
    return runs;
  }

  /// Among 30 000 readings evidence alone accepts some accelerations by chance. A run of accelerations is kept only if
  /// it raises the log-likelihood of the readings after it by enough (a factor of 8000): about one false run in a long
  /// session.
  void prune(std::size_t apart) {
    const std::vector<Run> runs = alive(apart);
    smoother_.score(spread_, noise_mm_ * noise_mm_, with_);
    // Every other run at a time: what is taken out must not spoil what follows its neighbour.
    for (std::size_t parity = 0; parity < 2; ++parity) {
      std::vector<double> trial = spread_;
      for (std::size_t r = parity; r < runs.size(); r += 2)
        for (std::size_t k = runs[r].first; k <= runs[r].last; ++k) trial[k] = kStill;
      smoother_.score(trial, noise_mm_ * noise_mm_, without_);
      for (std::size_t r = parity; r < runs.size(); r += 2) {
        const std::size_t end = r + 1 < runs.size() ? runs[r + 1].first + 1 : t_s_.size();
        double gain = 0.0;
        for (std::size_t k = runs[r].first + 1; k < end; ++k) gain += with_[k] - without_[k];
        if (gain >= deciding().acceleration_worth_nats) continue;
        for (std::size_t k = runs[r].first; k <= runs[r].last; ++k) spread_[k] = kStill;
      }
    }
    refine(kPruned);
  }

  /// Where pruning went too far the readings leave the line together, by five standard deviations of their mean: those
  /// stretches may accelerate again. False when there are none.
  bool open_again() {
    const std::size_t n = t_s_.size();
    smooth();
    std::vector<double> sum(n + 1, 0.0);
    for (std::size_t k = 0; k < n; ++k) sum[k + 1] = sum[k] + (reading_mm_[k] - smoother_.states()[k].x) / noise_mm_;
    bool opened = false;
    for (const std::size_t width : {4u, 8u, 16u, 48u}) {
      for (std::size_t k = 0; k + width <= n; ++k) {
        if (std::fabs(sum[k + width] - sum[k]) <
            deciding().leaves_line_deviations * std::sqrt(static_cast<double>(width)))
          continue;
        const std::size_t from = k > width / 2 + 2 ? k - width / 2 - 2 : 0;
        for (std::size_t j = from; j < std::min(k + width + width / 2 + 2, n - 1); ++j) {
          const double h = t_s_[j + 1] - t_s_[j];
          spread_[j] = std::max(spread_[j], 4.0 * noise_mm_ * noise_mm_ / (h * h * h * h));
        }
        opened = true;
      }
    }
    return opened;
  }

  std::span<const double> t_s_;
  std::span<const double> reading_mm_;
  double noise_mm_;
  const MotionProgress& on_progress_;
  int passes_ = 0;
  AccelerationSmoother smoother_;
  std::vector<double> spread_, mean_, variance_, next_;  ///< of the acceleration, one per interval
  std::vector<double> with_, without_;                   ///< log-likelihood of every reading
};

}  // namespace

Motion smooth_motion(std::span<const double> t_s, std::span<const double> reading_mm, const ChannelQuality& quality,
                     const MotionProgress& on_progress) {
  const std::size_t n = t_s.size();
  Motion motion;
  if (n < 3) {
    motion.position_mm.assign(reading_mm.begin(), reading_mm.end());
    motion.velocity_mm_s.assign(n, 0.0);
    motion.acceleration_mm_s2.assign(n, 0.0);
    motion.position_variance_mm2.assign(n, quality.noise * quality.noise);
    return motion;
  }
  const auto [low, high] = std::minmax_element(reading_mm.begin(), reading_mm.end());
  motion.quantisation_mm = quality.step;
  // A staircase wider than the noise hides it; its error is uniform within a step.
  const double noise_mm = std::max({quality.noise, quality.rounding(), 1e-7 * (*high - *low), 1e-12});
  motion.assumed_noise_mm = noise_mm;
  SparseMotion sparse(t_s, reading_mm, noise_mm, on_progress);
  const auto& states = sparse.search();
  motion.position_mm.resize(n);
  motion.velocity_mm_s.resize(n);
  motion.acceleration_mm_s2.resize(n);
  motion.position_variance_mm2.resize(n);
  motion.log_likelihood = sparse.log_likelihood();
  motion.turns.assign(n, false);
  for (std::size_t k = 1; k + 1 < n; ++k) motion.turns[k] = sparse.turns(k - 1);
  double squares = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    motion.position_mm[k] = states[k].x;
    motion.position_variance_mm2[k] = std::clamp(states[k].pxx, 0.0, noise_mm * noise_mm);
    // At a reading: the mean of what was before and what comes after.
    const double after = states[k].v, before = k > 0 ? states[k - 1].v : after;
    motion.velocity_mm_s[k] = 0.5 * (before + after);
    if (k > 0 && k + 1 < n) motion.acceleration_mm_s2[k] = (after - before) / (0.5 * (t_s[k + 1] - t_s[k - 1]));
    const double e = reading_mm[k] - motion.position_mm[k];
    squares += e * e;
  }
  motion.noise_mm = std::sqrt(squares / static_cast<double>(n));
  return motion;
}

}  // namespace isorig::identify
