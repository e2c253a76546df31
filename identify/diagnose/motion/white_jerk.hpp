#pragma once
#include <Eigen/Dense>
#include <span>
#include <vector>

namespace isorig::identify {

/// How a motion joins what lies before or after it: each with its variance, a large one where it is a guess.
struct MotionEnd {
  double position_mm = 0.0, position_variance_mm2 = 0.0;
  double velocity_mm_s = 0.0, velocity_variance_mm2_s2 = 0.0;
  double acceleration_variance_mm2_s4 = 0.0;  ///< about none
  std::size_t corner_rows = 0;                ///< so many readings at this end may be a corner, with a jerk beyond q
};

/// A motion whose acceleration is a random walk (white jerk), from readings of its position. State (position, velocity,
/// acceleration); the acceleration is the integral of white noise of spectral density q in mm^2/s^5, `jerk2`. Over a
/// step h, exactly (Bar-Shalom, Li & Kirubarajan 2001, ch. 6, "Wiener process acceleration"):
///
///     x <- F x,   P <- F P F' + Q
///     F = | 1 h h^2/2 |     Q = q | h^5/20  h^4/8  h^3/6 |
///         | 0 1 h     |           | h^4/8   h^3/3  h^2/2 |
///         | 0 0 1     |           | h^3/6   h^2/2  h     |
class WhiteJerkSmoother {
 public:
  /// What is passed must outlive it. `before` is the state before the first reading is seen.
  WhiteJerkSmoother(std::span<const double> t_s, std::span<const double> reading_mm, double noise_mm,
                    const MotionEnd& before, const MotionEnd& after)
      : t_s_(t_s), y_(reading_mm), noise2_(noise_mm * noise_mm), before_(before), after_(after) {}

  /// Forward (Kalman 1960); returns ln L(q) = -1/2 sum (e^2 / S + ln S) over the innovations e of variance S
  /// (Schweppe 1965), by which q is chosen. What is known of velocity and acceleration at the end enters as readings.
  double filter(double jerk2);
  /// filter() with the q of the largest ln L, of 10 mm^2/s^5 and every fourfold of it below 10^12; returns that ln L.
  double filter_likeliest();
  /// The same for stretches of any length and unit: uphill from this q by factors of 16, then of 4.
  double filter_likeliest_from(double jerk2);

  struct Smoothed {
    Eigen::Vector3d mean;
    double position_variance_mm2;
  };
  /// After filter(), backward (Rauch, Tung & Striebel 1965): with ^- what was predicted for a reading,
  ///
  ///     G_k = P_k F' (P^-_k+1)^-1,   x^s_k = x_k + G_k (x^s_k+1 - x^-_k+1)
  ///     P^s_k = P_k + G_k (P^s_k+1 - P^-_k+1) G_k'
  [[nodiscard]] std::vector<Smoothed> smooth() const;

 private:
  struct State {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();
  };
  static double observe(State& s, int which, double value, double noise2);

  std::span<const double> t_s_;
  std::span<const double> y_;
  double noise2_;
  MotionEnd before_, after_;
  std::vector<State> filtered_, predicted_;
};

}  // namespace isorig::identify
