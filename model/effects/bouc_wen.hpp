#pragma once
#include <algorithm>
#include <array>
#include <cmath>

#include "model/stepping.hpp"

namespace isorig::model::effect {

/// Bouc-Wen's bristle in its normalised form (Bouc 1967; Wen 1976; Ikhouane & Rodellar 2005), z in [-1, 1]:
///
///     dz/dx = (1 - |z|^n (sigma sign(z dx) + 1 - sigma)) / delta,   sigma = beta / (beta + gamma)
///
/// n >= 1, how sharply loading turns into sliding: n = 1 with sigma = 1 is Dahl's bristle, n without end is Jenkins'
/// spring. sigma, how steep an unloading is: it begins 2 sigma times as steep as the first loading, and at 1/2
/// (beta = gamma) it is a straight line. The work put in less delta z^2 / 2 grows at |z|^n |z dx| in loading and at
/// (2 sigma - 1) times that in unloading: passive for sigma >= 1/2, whatever n (Erlicher & Point 2004).
///
/// Rate-independent. With u = z sign(dx) a monotone motion runs along one curve, du/ds = f(u), f = 1 - u^n for u > 0
/// and 1 + (2 sigma - 1) |u|^n below, s the way in units of delta. The curve is tabulated once (classical Runge-Kutta,
/// cubic between the knots), so that a step of any length is a walk along it: the error is that of the table, below
/// 1e-5 of the sliding force, and steps do not add to it. Beyond the table 1 - u decays as exp(-n s).
class BoucWenBristle {
 public:
  BoucWenBristle(double presliding_mm, double exponent, double beta_share) noexcept
      : presliding_mm_(presliding_mm),
        exponent_(exponent),
        unloading_(2.0 * beta_share - 1.0),
        knot_(kKnot / exponent),
        knots_(1.0 / knot_) {
    tabulate();
  }
  void reset() noexcept {
    direction_ = 0.0;
    way_ = way_to(0.0);
    z_ = 0.0;
  }
  /// z after sliding on by `slide_mm`.
  double slide(double slide_mm) noexcept {
    const double s = sign_of(slide_mm);
    if (s == 0.0) return z_;
    if (s != direction_) {
      way_ = way_to(s * z_);
      direction_ = s;
    }
    way_ += std::fabs(slide_mm) / presliding_mm_;
    return z_ = s * along(way_);
  }

 private:
  static constexpr double kKnot = 0.05;        // way between knots, times n: the knee is 1 / n wide
  static constexpr double kTabulated = 1e-4;   // of 1 - u, where the exponential takes over
  static constexpr std::size_t kBefore = 256;  // knots with u < 0: n / kKnot at most, n up to 12
  static constexpr std::size_t kAfter = 768;   // with u > 0: (n + ln(n / kTabulated)) / kKnot at most

  [[nodiscard]] double slope(double u) const noexcept {
    const double power = std::pow(std::fabs(u), exponent_);
    return u > 0.0 ? 1.0 - power : 1.0 + unloading_ * power;
  }
  [[nodiscard]] double stepped(double u, double h) const noexcept {
    const double k1 = slope(u), k2 = slope(u + 0.5 * h * k1), k3 = slope(u + 0.5 * h * k2), k4 = slope(u + h * k3);
    return u + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  /// From u = 0, where the slope may bend, both ways.
  void tabulate() noexcept {
    first_ = last_ = kBefore;
    set(kBefore, 0.0);
    while (u_[first_] > -1.0 && first_ > 0) {
      set(first_ - 1, stepped(u_[first_], -knot_));
      --first_;
    }
    while (u_[last_] < 1.0 - kTabulated && last_ + 1 < u_.size()) {
      set(last_ + 1, stepped(u_[last_], knot_));
      ++last_;
    }
    end_ = static_cast<double>(last_ - first_) * knot_;
  }
  void set(std::size_t knot, double u) noexcept {
    u_[knot] = u;
    slope_[knot] = slope(u);
  }
  /// The cubic between a knot and the next that has the slopes of both, at a share of the way.
  [[nodiscard]] double between(std::size_t knot, double share) const noexcept {
    const double rest = 1.0 - share, rise = u_[knot + 1] - u_[knot];
    return u_[knot] + rise * share * share * (3.0 - 2.0 * share) +
           knot_ * share * rest * (rest * slope_[knot] - share * slope_[knot + 1]);
  }
  [[nodiscard]] double along(double way) const noexcept {
    if (way >= end_) return 1.0 - (1.0 - u_[last_]) * std::exp(-exponent_ * (way - end_));
    const double at = std::fmax(way * knots_, 0.0);
    const std::size_t knot = std::min(first_ + static_cast<std::size_t>(at), last_ - 1);
    return between(knot, at - static_cast<double>(knot - first_));
  }
  /// Where the curve has the height `u`.
  [[nodiscard]] double way_to(double u) const noexcept {
    if (u >= u_[last_]) return end_ + std::log((1.0 - u_[last_]) / std::fmax(1.0 - u, 1e-300)) / exponent_;
    const auto above = std::upper_bound(u_.begin() + static_cast<std::ptrdiff_t>(first_),
                                        u_.begin() + static_cast<std::ptrdiff_t>(last_), u);
    const auto knot = std::max(static_cast<std::size_t>(above - u_.begin()), first_ + 1) - 1;
    double share = (u - u_[knot]) / (u_[knot + 1] - u_[knot]);
    for (int pass = 0; pass < 3; ++pass)  // Newton, by the slope of the curve at the height reached
      share += (u - between(knot, share)) / (knot_ * slope(between(knot, share)));
    return (static_cast<double>(knot - first_) + std::clamp(share, 0.0, 1.0)) * knot_;
  }

  double presliding_mm_;
  double exponent_;
  double unloading_;  // 2 sigma - 1
  double knot_;       // way between two knots
  double knots_;      // per way
  std::size_t first_ = kBefore, last_ = kBefore;
  double end_ = 0.0;
  std::array<double, kBefore + kAfter> u_{}, slope_{};
  double direction_ = 0.0;
  double way_ = 0.0;
  double z_ = 0.0;
};

}  // namespace isorig::model::effect
