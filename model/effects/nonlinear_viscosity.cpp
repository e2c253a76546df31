#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// Maxwell arm whose dashpot follows a power law. In the elongation z of the arm's spring the law holds no
/// stiffness: dz/dt = v - (|z| / 1 mm)^(m-1) z / tau. Exponential midpoint, stable at any step, with
/// Richardson extrapolation; steps are cut until a whole and two halves agree to kTolerance_mm (times
/// the longest elongation, beyond 1 mm), which keeps the error below 1e-4 of the peak, or 5e-5 mm where that is more
/// (tests/model/effects).
class PowerArm : public Process {
 public:
  PowerArm(double time_constant_s, double exponent) noexcept : tau_s_(time_constant_s), exponent_(exponent) {}
  void reset(const Instant&) noexcept override { z_ = longest_mm_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    if (now.dt_s > 0.0) {
      const double v = now.step_mm / now.dt_s, tolerance_mm = kTolerance_mm * std::fmax(1.0, longest_mm_);
      double left_s = now.dt_s, h = now.dt_s;
      for (int guard = 0; left_s > 0.0; ++guard) {
        h = guard < kMostTries ? std::fmin(h, left_s) : left_s;
        const double r = rate(z_), whole = midpoint(z_, v, h, r);
        // In a hold the rate hardly changes within a step: the midpoint's own error is below the tolerance.
        const double turned = std::fabs(v) * h + std::fabs(z_) * r * h;
        if (r * h * square((exponent_ - 1.0) * turned) < tolerance_mm * std::fabs(z_)) {
          z_ = whole;
          left_s -= h;
          h = left_s;
          continue;
        }
        const double half = midpoint(z_, v, 0.5 * h, r);
        const double halves = midpoint(half, v, 0.5 * h, rate(half));
        const double error_mm = std::fabs(halves - whole) / 3.0;
        if (error_mm > tolerance_mm && guard < kMostTries) {
          h *= 0.5;
          continue;
        }
        z_ = halves + (halves - whole) / 3.0;
        left_s -= h;
        if (error_mm < 0.1 * tolerance_mm) h *= 2.0;
      }
      longest_mm_ = std::fmax(longest_mm_, std::fabs(z_));
    }
    columns[0] = z_;
  }

 private:
  [[nodiscard]] double rate(double z) const noexcept {
    // Bounded: for exponents below 1 the rate grows without limit as z goes to zero.
    return std::fmin(std::pow(std::fmax(std::fabs(z), 1e-6), exponent_ - 1.0) / tau_s_, 1e6);
  }
  static double advance(double z, double v, double h, double r) noexcept {
    const Relaxation step = relaxation(h * r);
    return z * step.decay + v * h * step.gain;
  }
  /// `r`: the rate at z.
  [[nodiscard]] double midpoint(double z, double v, double h, double r) const noexcept {
    return advance(z, v, h, rate(advance(z, v, 0.5 * h, r)));
  }
  static double square(double x) noexcept { return x * x; }

  static constexpr int kMostTries = 60;
  static constexpr double kTolerance_mm = 2e-6;  // of an extension up to 1 mm; a share of a longer one
  double tau_s_;
  double exponent_;
  double z_ = 0.0;
  double longest_mm_ = 0.0;  // of |z_| so far
};

/// Maxwell arm whose dashpot yields: it flows only beyond a yield elongation y of its spring (Bingham).
class YieldArm : public Process {
 public:
  YieldArm(double time_constant_s, double yield_mm) noexcept : tau_s_(time_constant_s), yield_mm_(yield_mm) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    step(now.step_mm, now.dt_s);
    columns[0] = z_;
  }

 private:
  // Exact: rigid within the yield limit, a linear arm about +-y outside of it.
  void step(double step_mm, double dt_s) noexcept {
    for (int part = 0; part < 4 && dt_s > 0.0; ++part) {
      const double v = step_mm / dt_s;
      const double side = std::fabs(z_) > yield_mm_ ? sign_of(z_) : std::fabs(z_) < yield_mm_ ? 0.0 : sign_of(v);
      if (side == 0.0 || (std::fabs(z_) == yield_mm_ && side != sign_of(z_))) {
        const double target = sign_of(v) * yield_mm_;
        const double needed_s = v == 0.0 ? dt_s : (target - z_) / v;
        if (needed_s >= dt_s) {
          z_ += step_mm;
          return;
        }
        z_ = target;
        step_mm -= v * needed_s;
        dt_s -= needed_s;
        continue;
      }
      const double edge = side * yield_mm_;
      const double decay = -std::expm1(-dt_s / tau_s_);
      const double after = (z_ - edge) + decay * (v * tau_s_ - (z_ - edge));
      if (after * side >= 0.0) {
        z_ = edge + after;
        return;
      }
      // It comes back to the edge within the step, after t with (w - v tau) exp(-t / tau) + v tau = 0.
      const double w = z_ - edge;
      const double needed_s = std::clamp(tau_s_ * std::log((w - v * tau_s_) / (-v * tau_s_)), 0.0, dt_s);
      z_ = edge - side * 1e-12;
      step_mm -= v * needed_s;
      dt_s -= needed_s;
    }
  }

  double tau_s_;
  double yield_mm_;
  double z_ = 0.0;
};

class PowerDashpot : public Process {
 public:
  explicit PowerDashpot(double exponent) noexcept : exponent_(exponent) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = sign_of(now.velocity_mm_s) * std::pow(std::fabs(now.velocity_mm_s), exponent_);
  }

 private:
  double exponent_;
};

const Coefficient kArmStiffness{
    .name = "stiffness_N_mm",
    .symbol = "k",
    .sign = Sign::kNonNegative,
    .sheet = {.what = "Stiffness of the arm's spring: the force per mm that a step adds at once.",
              .unit = "N/mm",
              .range = "Physics: a spring pushes back, so it is not negative; no upper bound.",
              .errors = "Where the fastest ramp lasts longer than the time constant it cannot be separated from it. "
                        "Mistaken for the "
                        "parallel spring."}};

}  // namespace

const Physics& nonlinear_viscosity() {
  static const Physics physics{
      "nonlinear_viscosity",
      Stage::kSpecimen,
      "A dashpot that is not linear in rate: power law or yield.",
      "Power law: de Waele 1923, Ostwald 1925; yield: Bingham 1922 (Carbopol gels, as in the paper's sheaths, follow "
      "both: Herschel & Bulkley 1926).",
      "Ramps over three decades of velocity: the time constant seen in a hold falls with the force. Mistaken "
      "for a "
      "second relaxation time at one amplitude; a second amplitude tells them apart.",
      {{"power_arm",
        "F = k z, dz/dt = v - (|z| / 1 mm)^(m-1) z / tau",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 1e-3,
          .upper = 1e4,
          .starts = {0.5, 3.0},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
          .sheet = {.what = "Time constant at an arm elongation of 1 mm; it grows or falls from there by |z|^(1-m).",
                    .unit = "s",
                    .range = "Instrument: 1 ms is one interval at 1 kHz, below which the arm is a dashpot; 1e4 s is "
                             "beyond the longest hold, where it is a spring.",
                    .errors = "Where the arm never comes near 1 mm it is an extrapolation that cannot be separated "
                              "from the exponent. "
                              "Mistaken for the linear arm's time constant."}},
         {.name = "exponent",
          .symbol = "m",
          .lower = 0.4,
          .upper = 6.0,
          .starts = {0.7, 1.5},
          .logarithmic = true,
          .sheet =
              {.what = "Exponent m of the arm's flow; above 1 it thins with force, 1 is linear, below 1 it thickens.",
               .unit = "1",
               .range =
                   "Numerics: below 1 the rate grows without limit as the arm relaxes and is cut at 1e6 per s, so m "
                   "ends at 0.4; above 6 a doubled speed adds less than 12 % of force, and the arm is one that yields.",
               .errors =
                   "One amplitude cannot separate it from the time constant. Mistaken for a second relaxation time."}}},
        {kArmStiffness},
        [](std::span<const double> p, const Reference&) { return std::make_unique<PowerArm>(p[0], p[1]); },
        {.replaces_arm = true}},
       {"yield_arm",
        "F = k z, dz/dt = v - sign(z) max(0, |z| - y) / tau",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 1e-3,
          .upper = 1e4,
          .starts = {0.5, 3.0},
          .logarithmic = true,
          .traits = {.lower_bound_is = "coulomb_friction", .upper_limit_law = "a spring"},
          .sheet = {.what = "Time constant with which the arm relaxes towards its yield elongation.",
                    .unit = "s",
                    .range =
                        "Instrument: 1 ms is one interval at 1 kHz, below which the arm is a slipping spring; 1e4 s is "
                        "beyond the longest hold, where it is a spring.",
                    .errors = "A hold shorter than it cannot separate it from the yield. Mistaken for the linear arm's "
                              "time constant."}},
         {.name = "yield_mm",
          .symbol = "y",
          .lower = 1e-3,
          .upper = 3.0,
          .starts = {0.05, 0.4},
          .logarithmic = true,
          .sheet = {.what = "Elongation of the arm's spring below which its dashpot does not flow.",
                    .unit = "mm",
                    .range = "Instrument: 1 um is a few times a good frame's position noise; 3 mm is more than half of "
                             "the rig's travel to either side, and the arm never yields.",
                    .errors = "A slow relaxation that a hold did not show to its end adds to it. Mistaken for "
                              "coulomb_friction with presliding."}}},
        {kArmStiffness},
        [](std::span<const double> p, const Reference&) { return std::make_unique<YieldArm>(p[0], p[1]); },
        {.replaces_arm = true}},
       {"power_dashpot",
        "F = c sign(v) |v / (1 mm/s)|^n",
        // A flow that hardly depends on the rate is dry friction.
        {{.name = "exponent",
          .symbol = "n",
          .lower = 0.3,
          .upper = 3.0,
          .starts = {0.5, 2.0},
          .logarithmic = true,
          .traits = {.lower_bound_is = "coulomb_friction"},
          .sheet = {.what = "Exponent n of the drag in the speed; below 1 it thins, 1 is linear, above 1 it thickens.",
                    .unit = "1",
                    .range = "Physics: below 0.3 the drag doubles only over a decade of speed and is dry friction; "
                             "above 3 no fluid at these speeds thickens.",
                    .errors =
                        "One decade of speed leaves it uncertain. Mistaken for friction with a Stribeck curve."}}},
        {{.name = "viscosity_N",
          .symbol = "c",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Drag at a speed of 1 mm/s.",
                    .unit = "N",
                    .range = "Physics: drag dissipates, so it is not negative; no upper bound.",
                    .errors = "Where no ramp comes near 1 mm/s it is an extrapolation that cannot be separated from "
                              "the exponent. Mistaken "
                              "for friction."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<PowerDashpot>(p[0]); }}},
      {.acts_on = "dashpot",
       .depends_on = {"rate"},
       .shape_of = ShapeOf::kRate,
       .words = "viscosity that is not linear"}};
  return physics;
}

}  // namespace isorig::model::effect
