#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// Maxwell arm whose dashpot has one coefficient while it lengthens (z > 0, its spring pulls) and another while it
/// shortens. Exact at constant velocity: z crosses zero at most once within a step, and on either side of it the arm is
/// linear.
class DirectionalArm : public Process {
 public:
  DirectionalArm(double lengthening_s, double shortening_s) noexcept
      : lengthening_s_(lengthening_s), shortening_s_(shortening_s) {}
  void reset(const Instant&) noexcept override { z_mm_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    step(now.step_mm, now.dt_s);
    columns[0] = z_mm_;
  }

 private:
  void step(double step_mm, double dt_s) noexcept {
    if (dt_s <= 0.0) {
      z_mm_ += step_mm;
      return;
    }
    const double v = step_mm / dt_s;
    if (z_mm_ * v < 0.0) {
      // (z - v tau) exp(-t / tau) + v tau = 0
      const double tau_s = time_constant_s(z_mm_);
      const double crossing_s = tau_s * std::log1p(-z_mm_ / (v * tau_s));
      if (crossing_s >= dt_s) {
        relax(v, dt_s, tau_s);
        return;
      }
      z_mm_ = 0.0;
      dt_s -= crossing_s;
    }
    relax(v, dt_s, time_constant_s(z_mm_ != 0.0 ? z_mm_ : v));
  }
  void relax(double v, double h, double tau_s) noexcept { z_mm_ -= std::expm1(-h / tau_s) * (v * tau_s - z_mm_); }
  [[nodiscard]] double time_constant_s(double side) const noexcept {
    return side > 0.0 ? lengthening_s_ : shortening_s_;
  }

  double lengthening_s_;
  double shortening_s_;
  double z_mm_ = 0.0;
};

class DirectionalDashpot : public Process {
 public:
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::fmax(now.velocity_mm_s, 0.0);
    columns[1] = std::fmin(now.velocity_mm_s, 0.0);
  }
};

}  // namespace

/// Damping that differs between lengthening and shortening. Reynolds et al. found the damping of a pneumatic muscle
/// smaller in relaxation than in contraction. Two places for it:
///   `series`    the dashpot of a Maxwell arm: dz/dt = v - z / tau, tau for z > 0 (the dashpot lengthens), r tau for
///               z < 0; r = eta_shortening / eta_lengthening, 1 is the linear arm
///   `parallel`  F = c+ max(v, 0) + c- min(v, 0)
/// Signs: both dashpots dissipate, c >= 0, tau > 0. Units: c N s/mm, tau s. Range: r from 0.02 to 50, within which the
/// slower of the two still relaxes in the holds that show the faster. Errors: exact for motion at constant velocity.
/// Passive. friction_asymmetry is the other writing of `parallel` beside dry friction (half differences); the nonlinear
/// dashpots of nonlinear_viscosity are the same in both directions.
/// Source: Reynolds et al. 2003, Ann. Biomed. Eng. 31:310.
const Physics& directional_damping() {
  static const Physics physics{
      "directional_damping",
      Stage::kSpecimen,
      "Another dashpot coefficient in shortening than in lengthening.",
      "Reynolds et al. 2003, Ann. Biomed. Eng. 31:310 (pneumatic muscle: damping in contraction and in relaxation).",
      "The same ramp with its hold in both directions, at several velocities: the relaxation in the holds differs. "
      "Mistaken for pressure_coupling where the pressure gives way to the motion, for strain-dependent relaxation "
      "(quasi_linear_viscoelasticity) when lengthening is only ever seen above the rest position and shortening below, "
      "and beside dry friction for friction_asymmetry.",
      {{"series",
        "F = k z, dz/dt = v - z / tau (z > 0), v - z / (r tau) (z < 0)",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 1e-3,
          .upper = 1e4,
          .starts = {0.8},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
          .sheet = {.what = "Time constant of the arm while its dashpot lengthens.",
                    .unit = "s",
                    .range = "Instrument: 1 ms is one interval at 1 kHz, below which the arm is a dashpot; 1e4 s is "
                             "beyond the longest hold, where it is a spring.",
                    .errors = "A recording whose holds all follow shortening does not determine it. Mistaken for the "
                              "linear arm's time constant."}},
         {.name = "shortening_ratio",
          .symbol = "r",
          .lower = 0.02,
          .upper = 50.0,
          .starts = {1.0},
          .logarithmic = true,
          .sheet = {.what = "Dashpot coefficient in shortening over that in lengthening; 1 is the linear arm.",
                    .unit = "1",
                    .range = "Instrument: beyond a factor of 50 the slower of the two no longer relaxes in the holds "
                             "that show the faster.",
                    .errors = "Holds after one direction only leave it undetermined. Mistaken for strain-dependent "
                              "relaxation when lengthening is only seen above the rest position."}}},
        {{.name = "stiffness_N_mm",
          .symbol = "k",
          .sign = Sign::kNonNegative,
          .sheet =
              {.what = "Stiffness of the arm's spring: the force per mm that a step adds at once.",
               .unit = "N/mm",
               .range = "Physics: a spring pushes back, so it is not negative; no upper bound.",
               .errors =
                   "Where the fastest ramp lasts longer than both time constants it cannot be separated from them. "
                   "Mistaken for the parallel spring."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<DirectionalArm>(p[0], p[0] * p[1]); },
        {.replaces_arm = true}},
       {"parallel",
        "F = c+ max(v, 0) + c- min(v, 0)",
        {},
        {{.name = "lengthening_viscosity_N_s_mm",
          .symbol = "c+",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Force per speed of lengthening.",
                    .unit = "N s/mm",
                    .range = "Physics: a dashpot dissipates, so it is not negative; no upper bound.",
                    .errors =
                        "Ramps at one speed cannot separate it from dry friction. Mistaken for friction_asymmetry "
                        "beside dry friction."}},
         {.name = "shortening_viscosity_N_s_mm",
          .symbol = "c-",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Force per speed of shortening.",
                    .unit = "N s/mm",
                    .range = "Physics: a dashpot dissipates, so it is not negative; no upper bound.",
                    .errors =
                        "Ramps at one speed cannot separate it from dry friction. Mistaken for friction_asymmetry "
                        "beside dry friction."}}},
        [](auto, const Reference&) { return std::make_unique<DirectionalDashpot>(); }}},
      {.unusual = true,
       .contains = {"viscous_drag"},
       .acts_on = "dashpot",
       .depends_on = {"rate", "direction"},
       .shape_of = ShapeOf::kRate,
       .words = "damping that differs by direction"}};
  return physics;
}

}  // namespace isorig::model::effect
