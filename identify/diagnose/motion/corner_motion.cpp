#include "identify/diagnose/motion/corner_motion.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

namespace isorig::identify {
namespace {

struct State {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();
};

// State (position, velocity, acceleration); the acceleration is the integral of white noise of spectral density q in
// mm^2/s^5, `jerk2`. Over a step h, exactly (Bar-Shalom, Li & Kirubarajan 2001, ch. 6, "Wiener process acceleration"):
//
//     x <- F x,   P <- F P F' + Q
//     F = | 1 h h^2/2 |     Q = q | h^5/20  h^4/8  h^3/6 |
//         | 0 1 h     |           | h^4/8   h^3/3  h^2/2 |
//         | 0 0 1     |           | h^3/6   h^2/2  h     |
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

struct End {
  double velocity_mm_s;
  bool moves;  ///< it already turns there: the velocity is a guess
};

/// One corner, between two straight lines.
class Corner {
 public:
  Corner(std::span<const double> t_s, std::span<const double> y, double noise_mm, End before, End after)
      : t_s_(t_s), y_(y), noise2_(noise_mm * noise_mm), before_(before), after_(after) {}

  /// Forward (Kalman 1960); returns ln L(q) = -1/2 sum (e^2 / S + ln S) over the innovations e of variance S
  /// (Schweppe 1965), by which q is chosen. The lines before and after enter as readings of velocity and acceleration,
  /// certain to a position noise over the length of the corner, or hardly at all where the motion already turns.
  double filter(double jerk2) {
    const std::size_t n = t_s_.size();
    filtered_.assign(n, {});
    predicted_.assign(n, {});
    State s;
    s.mean << y_[0], before_.velocity_mm_s, 0.0;
    const double span_s = t_s_[n - 1] - t_s_[0];
    const auto speed2 = [&](const End& end) { return (end.moves ? 1e6 : 1.0) * noise2_ / (span_s * span_s); };
    const auto turn2 = [](const End& end) { return end.moves ? 1e6 : 1.0; };
    s.cov.diagonal() << 4.0 * noise2_, speed2(before_), turn2(before_);
    double log_likelihood = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      if (k > 0) {
        const double h = t_s_[k] - t_s_[k - 1];
        const Eigen::Matrix3d f = transition(h);
        s.mean = f * s.mean;
        s.cov = f * s.cov * f.transpose() + growth(h, jerk2);
      }
      predicted_[k] = s;
      log_likelihood += observe(s, Eigen::RowVector3d(1.0, 0.0, 0.0), y_[k], noise2_);
      if (k + 1 == n) {
        // Straight on: its velocity is that of the line after it, its acceleration none.
        log_likelihood += observe(s, Eigen::RowVector3d(0.0, 1.0, 0.0), after_.velocity_mm_s, speed2(after_));
        log_likelihood += observe(s, Eigen::RowVector3d(0.0, 0.0, 1.0), 0.0, turn2(after_));
      }
      filtered_[k] = s;
    }
    return log_likelihood;
  }

  /// After filter(), backward (Rauch, Tung & Striebel 1965): with ^- what was predicted for a reading,
  ///
  ///     G_k = P_k F' (P^-_k+1)^-1,   x^s_k = x_k + G_k (x^s_k+1 - x^-_k+1)
  void smooth(double* acceleration) const {
    const std::size_t n = t_s_.size();
    Eigen::Vector3d mean = filtered_[n - 1].mean;
    acceleration[n - 1] = mean[2];
    for (std::size_t k = n - 1; k-- > 0;) {
      const double h = t_s_[k + 1] - t_s_[k];
      const Eigen::Matrix3d gain = predicted_[k + 1].cov.ldlt().solve(transition(h) * filtered_[k].cov).transpose();
      mean = filtered_[k].mean + gain * (mean - predicted_[k + 1].mean);
      acceleration[k] = mean[2];
    }
  }

 private:
  /// Value z = H x + noise: e = z - H x, S = H P H' + r, x <- x + P H' e / S, P <- P - P H' H P / S.
  static double observe(State& s, const Eigen::RowVector3d& row, double value, double noise2) {
    const Eigen::Vector3d cross = s.cov * row.transpose();
    const double total = row * cross + noise2, e = value - row * s.mean;
    s.mean += cross * (e / total);
    s.cov -= cross * cross.transpose() / total;
    return -0.5 * (e * e / total + std::log(total));
  }

  std::span<const double> t_s_;
  std::span<const double> y_;
  double noise2_;
  End before_;
  End after_;
  std::vector<State> filtered_, predicted_;
};

}  // namespace

void smooth_corners(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion) {
  const std::size_t n = t_s.size();
  constexpr double kMargin_s = 0.03, kApart_s = 0.05, kStill_mm_s = 1e-6;
  constexpr std::size_t kFewest = 6;
  if (n < kFewest) return;
  std::vector<bool> moves(n, false), near(n, false);
  for (std::size_t k = 1; k + 1 < n; ++k) {
    moves[k] = std::fabs(motion.acceleration_mm_s2[k]) * 0.5 * (t_s[k + 1] - t_s[k - 1]) > kStill_mm_s;
    if (!moves[k]) continue;
    for (std::size_t j = k; t_s[k] - t_s[j] <= kMargin_s; --j) {
      near[j] = true;
      if (j == 0) break;
    }
    for (std::size_t j = k; j < n && t_s[j] - t_s[k] <= kMargin_s; ++j) near[j] = true;
  }
  const double noise_mm = std::max(motion.noise_mm, 1e-9);
  for (std::size_t first = 0; first < n; ++first) {
    if (!near[first]) continue;
    std::size_t end = first;
    while (end + 1 < n && near[end + 1] && t_s[end + 1] - t_s[end] < kApart_s) ++end;
    // Fewer readings than this in a corner: there is nothing to choose the strength of the jerk by.
    if (const std::size_t rows = end - first + 1; rows >= kFewest) {
      Corner corner(t_s.subspan(first, rows), reading_mm.subspan(first, rows), noise_mm,
                    {motion.velocity_mm_s[first], moves[first]}, {motion.velocity_mm_s[end], moves[end]});
      double best = -1e300, best_jerk2 = 1.0;
      for (double jerk2 = 1e1; jerk2 < 1e12; jerk2 *= 4.0) {
        if (const double value = corner.filter(jerk2); value > best) {
          best = value;
          best_jerk2 = jerk2;
        }
      }
      (void)corner.filter(best_jerk2);
      corner.smooth(&motion.acceleration_mm_s2[first]);
    }
    first = end;
  }
}

}  // namespace isorig::identify
