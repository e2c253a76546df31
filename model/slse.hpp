#pragma once
#include <array>
#include <cmath>
#include <cstddef>

namespace isorig::model {

/// What a Maxwell arm does in a step of z = gamma dt: `decay` = e^-z, `gain` = (1 - e^-z) / z.
struct Relaxation {
  double decay = 1.0;
  double gain = 1.0;
};

/// Valid for 0 <= z <= infinity; relative error below 1e-15 in both members over the whole range. The series
/// serves the fixed 1 ms step (z ~ 1e-4) without a library call and without a division; expm1 serves the middle, where
/// 1 - e^-z would cancel, and exp the tail, where 1 - (1 - e^-z) would.
inline Relaxation relaxation(double z) noexcept {
  if (z <= 0.03) {
    constexpr double kThird = 1.0 / 3.0, kFifth = 1.0 / 5.0, kSixth = 1.0 / 6.0, kSeventh = 1.0 / 7.0;
    const double beyond_4 = 1.0 - kFifth * z * (1.0 - kSixth * z * (1.0 - kSeventh * z * (1.0 - 0.125 * z)));
    const double gain = 1.0 - 0.5 * z * (1.0 - kThird * z * (1.0 - 0.25 * z * beyond_4));
    return {1.0 - z * gain, gain};
  }
  if (z <= 1.0) {
    const double lost = -std::expm1(-z);
    return {1.0 - lost, lost / z};
  }
  const double decay = std::exp(-z);
  return {decay, (1.0 - decay) / z};
}

/// Standard linear solid: a spring k1 beside a Maxwell arm (spring k2 in series with a damper eta).
///
///   F = k1 e + k2 e2,   de2/dt = de/dt - gamma e2,   gamma = k2 / eta,   kappa = k2 / k1
///
/// e is the strain [1], tension and extension positive; stiffnesses are normalised to strain [N], eta is in
/// [N s], gamma in [1/s]. Linear, so valid for any strain; k1 may be 0 (a bare Maxwell arm), k2 and gamma
/// must be >= 0. Source: Bennington, Wang et al., "Design and Characterization of Viscoelastic McKibben
/// Actuators with Tunable Force-Velocity Curves", eqs. 1 and 2. (Its eq. 3 lacks the factor k2 that eq. 1
/// gives the arm's strain; eq. 4, the force-velocity curve, has it again as kappa.)
struct SlseParameters {
  double k1_N = 0.0;
  double k2_N = 0.0;
  double gamma_1_s = 0.0;

  [[nodiscard]] static constexpr SlseParameters from_ratios(double k1_N, double kappa, double gamma_1_s) noexcept {
    return {k1_N, kappa * k1_N, gamma_1_s};
  }
  [[nodiscard]] constexpr double kappa() const noexcept { return k2_N / k1_N; }
  [[nodiscard]] constexpr double eta_N_s() const noexcept { return k2_N / gamma_1_s; }
};

/// One element with its state. A step is the closed solution for a strain that moves linearly in it:
///
///   e2(t+dt) = e2(t) e^-z + de (1 - e^-z)/z,   z = gamma dt
///
/// so it is exact (to rounding) for every dt, and splitting a ramp changes nothing. Parameters may change
/// between steps (they follow the pressure); the state is the arm's strain, so the force follows k2 at once.
class Slse {
 public:
  SlseParameters parameters;

  Slse() = default;
  explicit Slse(const SlseParameters& p) noexcept : parameters(p) {}

  /// Steady state at `strain`: the arm is relaxed.
  void settle(double strain) noexcept {
    strain_ = strain;
    arm_strain_ = 0.0;
  }
  /// Steady state of an endless ramp through `strain`; needs gamma > 0.
  void settle_ramp(double strain, double rate_1_s) noexcept {
    strain_ = strain;
    arm_strain_ = rate_1_s / parameters.gamma_1_s;
  }
  /// Moves to `strain` at constant rate within `dt_s` > 0. Returns the force at the end [N].
  double step(double strain, double dt_s) noexcept { return step(strain, relaxation(parameters.gamma_1_s * dt_s)); }
  /// The same, for callers that keep relaxation(gamma dt) while neither changes.
  double step(double strain, const Relaxation& r) noexcept {
    arm_strain_ = arm_strain_ * r.decay + (strain - strain_) * r.gain;
    strain_ = strain;
    return force_N();
  }
  [[nodiscard]] double force_N() const noexcept { return parameters.k1_N * strain_ + parameters.k2_N * arm_strain_; }
  [[nodiscard]] double strain() const noexcept { return strain_; }
  [[nodiscard]] double arm_strain() const noexcept { return arm_strain_; }

 private:
  double strain_ = 0.0;
  double arm_strain_ = 0.0;
};

/// Elements side by side: one strain, forces add. Without allocation; at most kMaxElements.
class SlseStack {
 public:
  static constexpr std::size_t kMaxElements = 4;

  SlseStack() = default;
  /// False when the stack is full.
  bool add(const SlseParameters& parameters) noexcept;
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] Slse& operator[](std::size_t i) noexcept { return elements_[i]; }
  [[nodiscard]] const Slse& operator[](std::size_t i) const noexcept { return elements_[i]; }

  void settle(double strain) noexcept;
  double step(double strain, double dt_s) noexcept {
    double force_N = 0.0;
    for (std::size_t i = 0; i < size_; ++i) force_N += elements_[i].step(strain, dt_s);
    return force_N;
  }
  [[nodiscard]] double force_N() const noexcept;

 private:
  std::array<Slse, kMaxElements> elements_{};
  std::size_t size_ = 0;
};

}  // namespace isorig::model
