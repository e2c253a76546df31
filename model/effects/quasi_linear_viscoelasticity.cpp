#include <algorithm>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// The exponent of Fung's function at most: beyond it a force would leave what a double can square.
constexpr double kLargestExponent = 50.0;

double growth(double exponent_1_mm, double position_mm) noexcept {
  return std::exp(std::clamp(exponent_1_mm * position_mm, -kLargestExponent, kLargestExponent));
}

/// Maxwell arm driven by Fung's elastic function g(x) = (exp(b x) - 1) / b in place of x:
///
///     dz/dt = g'(x) v - z / tau = exp(b x) v - z / tau
///
/// Exact at constant velocity v over h: with q = b v h + h / tau,
///
///     z(h) = z exp(-h / tau) + v h exp(b x) (exp(b v h) - exp(-h / tau)) / q
class FungArm : public Process {
 public:
  FungArm(double time_constant_s, double exponent_1_mm) noexcept
      : tau_s_(time_constant_s), exponent_1_mm_(exponent_1_mm) {}
  void reset(const Instant&) noexcept override { z_mm_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    const double before = growth(exponent_1_mm_, now.position_mm - now.step_mm);
    const double after = growth(exponent_1_mm_, now.position_mm);
    const double decay = std::exp(-now.dt_s / tau_s_);
    const double q = exponent_1_mm_ * now.step_mm + now.dt_s / tau_s_;
    // Where q is small the difference of two numbers near one would lose it; the next term is q^2 / 6.
    constexpr double kSmall = 1e-6;
    const double driven = std::fabs(q) < kSmall ? before * decay * (1.0 + 0.5 * q) : (after - before * decay) / q;
    z_mm_ = z_mm_ * decay + now.step_mm * driven;
    columns[0] = z_mm_;
  }

 private:
  double tau_s_;
  double exponent_1_mm_;
  double z_mm_ = 0.0;
};

/// Maxwell arm whose time constant follows the position, tau exp(b x). A hold is exact. In motion the arm is stepped in
/// its own time s, ds = dt / tau(x), in which dz/ds = f - z with f = v tau(x). Over parts of |b dx| = 0.02, f is taken
/// as the parabola that has its values at both ends and its integral, which is v dt: that leaves (b dx)^3 / 20 of z,
/// 4e-7, however short the time constant is.
class StrainTimedArm : public Process {
 public:
  StrainTimedArm(double time_constant_s, double exponent_1_mm) noexcept
      : tau_s_(time_constant_s), exponent_1_mm_(exponent_1_mm) {}
  void reset(const Instant&) noexcept override { z_mm_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    double tau_s = tau_s_ * growth(exponent_1_mm_, now.position_mm - now.step_mm);
    if (now.dt_s <= 0.0) {
      z_mm_ += now.step_mm;
    } else {
      constexpr double kPart = 0.02, kMostParts = 2000.0;
      const double bent = exponent_1_mm_ * now.step_mm;
      const double parts = std::clamp(std::ceil(std::fabs(bent) / kPart), 1.0, kMostParts);
      const double h = now.dt_s / parts, v = now.step_mm / now.dt_s;
      const double turn = bent / parts;                                   // of ln tau over a part
      const double ratio = std::exp(turn);                                // of tau at its ends
      const double mean = turn == 0.0 ? 1.0 : -std::expm1(-turn) / turn;  // of 1 / tau, times tau at the start
      for (double part = 0.0; part < parts; part += 1.0) {
        advance(v * tau_s, v * tau_s * ratio, v * h, h / tau_s * mean);
        tau_s *= ratio;
      }
    }
    columns[0] = z_mm_;
  }

 private:
  /// dz/ds = f - z over s; f a parabola from `first` to `last` with the integral `sum`.
  void advance(double first, double last, double sum, double s) noexcept {
    constexpr double kShort = 1e-5;  // the next term of `share` is s^2 / 6
    const double decay = std::exp(-s);
    const double share = s < kShort ? 1.0 - 0.5 * s : -std::expm1(-s) / s;  // (1 - exp(-s)) / s
    // What a parabola of integral one over s adds at its end; in short steps by its series, next term s^3 / 30.
    constexpr double kShortBulge = 1e-2;
    const double bulge =
        s < kShortBulge ? 1.0 - 0.5 * s + 0.15 * s * s : 6.0 * (s - 2.0 + (s + 2.0) * decay) / (s * s * s);
    z_mm_ = z_mm_ * decay + first * (share - decay) + last * (1.0 - share) + (sum - 0.5 * s * (first + last)) * bulge;
  }

  double tau_s_;
  double exponent_1_mm_;
  double z_mm_ = 0.0;
};

/// Positive: stiffer, or slower, the longer the specimen is. 1 / mm is a factor of e over a millimetre: the braid of a
/// muscle of 90 mm changes its stiffness by that over several. It may be zero, where the law is the linear arm, hence
/// searched as it is and not by its logarithm.
const Parameter kStrainExponent{
    .name = "strain_exponent_1_mm",
    .symbol = "b",
    .lower = -1.0,
    .upper = 1.0,
    .starts = {0.05},
    .sheet = {
        .what =
            "Relative change of the arm's stiffness, or of its time constant, per mm of position; 0 is the linear arm.",
        .unit = "1/mm",
        .range =
            "Physics: a factor of e within 1 mm is beyond any braid; a muscle of 90 mm changes by that over several.",
        .errors = "Strokes about one position cannot separate it from the stiffness. Mistaken for a pressure that "
                  "follows the "
                  "motion."}};
const Parameter kTimeConstant{
    .name = "time_constant_s",
    .symbol = "tau",
    .lower = 1e-3,
    .upper = 1e4,
    .starts = {0.8},
    .logarithmic = true,
    .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
    .sheet = {.what = "Time constant of the arm, at position zero where it depends on position.",
              .unit = "s",
              .range =
                  "Instrument: 1 ms is one interval at 1 kHz, below which the arm is a dashpot; 1e4 s is beyond the "
                  "longest hold, where it is a spring.",
              .errors = "A hold shorter than it cannot separate it from the stiffness. Mistaken for the linear arm's "
                        "time constant."}};
const Coefficient kStiffnessAtZero{
    .name = "stiffness_N_mm",
    .symbol = "k",
    .sign = Sign::kNonNegative,
    .sheet = {.what = "Stiffness of the arm's spring at position zero: the force per mm that a step adds at once.",
              .unit = "N/mm",
              .range = "Physics: a spring pushes back, so it is not negative; no upper bound.",
              .errors = "Where the fastest ramp lasts longer than the time constant it cannot be separated from it. "
                        "Mistaken for the "
                        "parallel spring."}};

}  // namespace

/// Quasi-linear viscoelasticity. A linear arm relaxes by the same share wherever it is strained; Fung's arm is driven
/// by an elastic force that grows exponentially with strain, so that the relaxing force is nonlinear in amplitude while
/// its time course is not:
///
///     F(t) = integral of G(t - t') (d sigma_e / dx) dx,   sigma_e = k (exp(b x) - 1) / b,   G = exp(-t / tau)
///
/// Signs: tension and extension positive; k >= 0; b > 0 is stiffer (or slower) the longer the specimen is. Position
/// counts from the unpressurized rest length; another zero multiplies k by a constant and changes nothing else. Units:
/// k N/mm at x = 0, b 1/mm, tau s.
///   `fung_arm`         as above
///   `relaxation_time`  k the same everywhere, tau exp(b x): the rate of relaxation depends on strain, which Fung's
///                      separable form excludes (Provenzano et al. 2001)
/// Both laws describe the arm alone; a curved parallel spring is strain_stiffening beside it. If one law had both, a
/// fit could let b go to zero and keep the curve: a quadratic spring beside a linear arm, under this effect's name.
/// Range: |b| <= 1 / mm. Errors: `fung_arm` exact for motion at constant velocity; `relaxation_time` within 4e-7 of z.
/// Not passive for every motion: a stiffness that changes under load does work (a known limit of the separable form).
/// Sources: Fung 1981, Biomechanics, ch. 7; Suzuki et al. 2021, Fractal Fract. 5:223 (an exponential elastic response
/// in the separable form, of urinary bladder); Provenzano et al. 2001, Ann. Biomed. Eng. 29:908.
const Physics& quasi_linear_viscoelasticity() {
  static const Physics physics{
      "quasi_linear_viscoelasticity",
      Stage::kSpecimen,
      "Relaxation that depends on strain: stiffness or time constant of the arm.",
      "Fung 1981 (quasi-linear viscoelasticity); Suzuki et al. 2021, Fractal Fract. 5:223 (exponential elastic "
      "response, "
      "of bladder tissue); Provenzano et al. 2001, Ann. Biomed. Eng. 29:908 (rate of relaxation that depends on "
      "strain).",
      "Equal ramps with holds about several positions, and both ways from one: what relaxes, or how fast, differs. "
      "Mistaken for strain_stiffening, which is all there in a slow triangle and relaxes nothing; for "
      "nonlinear_viscosity, which depends on the arm's force and not on where it is strained; and for "
      "pressure_coupling where the pressure follows the motion.",
      {{"fung_arm",
        "F = k z, dz/dt = exp(b x) v - z / tau",
        {kTimeConstant, kStrainExponent},
        {kStiffnessAtZero},
        [](std::span<const double> p, const Reference&) { return std::make_unique<FungArm>(p[0], p[1]); },
        {.replaces_arm = true}},
       {"relaxation_time",
        "F = k z, dz/dt = v - z / (tau exp(b x))",
        {kTimeConstant, kStrainExponent},
        {kStiffnessAtZero},
        [](std::span<const double> p, const Reference&) { return std::make_unique<StrainTimedArm>(p[0], p[1]); },
        {.replaces_arm = true}}},
      {.unusual = true,
       .acts_on = "arm",
       .depends_on = {"hold", "strain"},
       .shape_of = ShapeOf::kStep,
       .words = "quasi-linear viscoelasticity"}};
  return physics;
}

}  // namespace isorig::model::effect
