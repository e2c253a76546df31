#include "identify/diagnose/motion/white_jerk.hpp"

#include <cmath>

namespace isorig::identify {
namespace {

/// A corner that a machine rounds in 20 ms has some 500 times the jerk of a sine of 0.5 Hz with the same velocity; q
/// goes with the square of the jerk.
constexpr double kCorner = 2.5e5;

Eigen::Matrix3d transition(double h) {
  Eigen::Matrix3d f;
  f << 1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0;
  return f;
}

Eigen::Matrix3d growth(double h, double jerk2) {
  const double h2 = h * h, h3 = h2 * h, h4 = h3 * h, h5 = h4 * h;
  Eigen::Matrix3d q;
  q << h5 / 20.0, h4 / 8.0, h3 / 6.0, h4 / 8.0, h3 / 3.0, h2 / 2.0, h3 / 6.0, h2 / 2.0, h;
  return jerk2 * q;
}

}  // namespace

/// Value z of one part of the state: e = z - x_i, S = P_ii + r, x <- x + P_:i e / S, P <- P - P_:i P_i: / S.
double WhiteJerkSmoother::observe(State& s, int which, double value, double noise2) {
  const Eigen::Vector3d cross = s.cov.col(which);
  const double total = cross[which] + noise2, e = value - s.mean[which];
  s.mean += cross * (e / total);
  s.cov -= cross * cross.transpose() / total;
  return -0.5 * (e * e / total + std::log(total));
}

double WhiteJerkSmoother::filter(double jerk2) {
  const std::size_t n = t_s_.size();
  filtered_.assign(n, {});
  predicted_.assign(n, {});
  State s;
  s.mean << before_.position_mm, before_.velocity_mm_s, 0.0;
  s.cov.diagonal() << before_.position_variance_mm2, before_.velocity_variance_mm2_s2,
      before_.acceleration_variance_mm2_s4;
  double log_likelihood = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    if (k > 0) {
      const double h = t_s_[k] - t_s_[k - 1];
      const Eigen::Matrix3d f = transition(h);
      s.mean = f * s.mean;
      const bool corner = k < before_.corner_rows || k + after_.corner_rows >= n;
      s.cov = f * s.cov * f.transpose() + growth(h, corner ? kCorner * jerk2 : jerk2);
    }
    predicted_[k] = s;
    log_likelihood += observe(s, 0, y_[k], noise2_);
    if (k + 1 == n) {
      if (std::isfinite(after_.position_variance_mm2))
        log_likelihood += observe(s, 0, after_.position_mm, after_.position_variance_mm2);
      log_likelihood += observe(s, 1, after_.velocity_mm_s, after_.velocity_variance_mm2_s2);
      log_likelihood += observe(s, 2, 0.0, after_.acceleration_variance_mm2_s4);
    }
    filtered_[k] = s;
  }
  return log_likelihood;
}

double WhiteJerkSmoother::filter_likeliest() {
  double best = -1e300, best_jerk2 = 1.0;
  for (double jerk2 = 1e1; jerk2 < 1e12; jerk2 *= 4.0) {
    if (const double value = filter(jerk2); value > best) {
      best = value;
      best_jerk2 = jerk2;
    }
  }
  return filter(best_jerk2);
}

double WhiteJerkSmoother::filter_likeliest_from(double jerk2) {
  constexpr int kMostSteps = 40;
  double best = filter(jerk2);
  for (const double factor : {16.0, 4.0}) {
    bool rose = false;
    for (const double by : {factor, 1.0 / factor}) {
      for (int step = 0; step < kMostSteps && !(rose && by < 1.0); ++step) {
        const double value = filter(jerk2 * by);
        if (value <= best) break;
        best = value;
        jerk2 *= by;
        rose = by > 1.0;
      }
    }
  }
  return filter(jerk2);
}

std::vector<WhiteJerkSmoother::Smoothed> WhiteJerkSmoother::smooth() const {
  const std::size_t n = t_s_.size();
  std::vector<Smoothed> out(n);
  Eigen::Vector3d mean = filtered_[n - 1].mean;
  Eigen::Matrix3d cov = filtered_[n - 1].cov;
  out[n - 1] = {mean, cov(0, 0)};
  for (std::size_t k = n - 1; k-- > 0;) {
    const double h = t_s_[k + 1] - t_s_[k];
    const Eigen::Matrix3d gain = predicted_[k + 1].cov.ldlt().solve(transition(h) * filtered_[k].cov).transpose();
    mean = filtered_[k].mean + gain * (mean - predicted_[k + 1].mean);
    cov = filtered_[k].cov + gain * (cov - predicted_[k + 1].cov) * gain.transpose();
    out[k] = {mean, cov(0, 0)};
  }
  return out;
}

}  // namespace isorig::identify
