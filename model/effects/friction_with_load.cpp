#include <cmath>

#include "model/effects/effects.hpp"
#include "model/effects/presliding.hpp"

namespace isorig::model::effect {
namespace {

/// The specimen's force times 1 + mu z, z a Dahl bristle: linear in its coefficients, since z knows only the motion.
class Loaded : public Process {
 public:
  Loaded(double presliding_mm, double share) noexcept : bristle_(presliding_mm), share_(share) {}
  void reset(const Instant&) noexcept override { bristle_.reset(); }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const double factor = 1.0 + share_ * bristle_.slide(now.slide_mm);
    for (double& column : columns) column *= factor;
  }

 private:
  DahlBristle bristle_;
  double share_;
};

}  // namespace

/// Friction in proportion to the load. Fibres that slide over a bladder or round a fitting are pressed on by their own
/// tension: the capstan gives F_out = F exp(+-mu theta), and with a = tanh(mu theta) the mean of the two branches times
/// 1 +- a. Written with the bristle z of coulomb_friction, dz/dx = (1 - z sign(dx)) / delta:
///
///     F = F_specimen (1 + a z)
///
/// Signs: extension positive, a >= 0 opposes the motion of a specimen in tension. A specimen that pushes would be
/// helped by it: the law is meant for tension, as braids carry it. Units: delta mm, a a ratio. Range: a up to 0.9 (mu
/// theta 1.5: half a turn at mu = 0.5); delta as for coulomb_friction. All other forces of the specimen are its load,
/// dry friction beside it included (a difference of a times Fc). Errors: z exact on monotone steps. Sources: Euler
/// 1769, Eytelwein 1808 (capstan); Duclusaud et al. 2025, arXiv 2410.08650 (load-dependent friction of
/// servo actuators); Tondu & Lopez 2000, IEEE Control Syst. Mag. 20(2):15 (thread against thread in a braid).
const Physics& friction_with_load() {
  static const Physics physics{
      "friction_with_load",
      Stage::kSpecimen,
      "Friction in proportion to the force that it acts beside.",
      "Capstan (Euler 1769, Eytelwein 1808); Duclusaud et al. 2025, arXiv 2410.08650 (load-dependent friction).",
      "Slow triangles of small amplitude about several positions: the loop's height grows with its mean force. "
      "Mistaken for "
      "coulomb_friction where the force hardly changes, and for friction_with_pressure where the load follows the "
      "pressure.",
      {{"capstan",
        "F = F_specimen (1 + a z), dz/dx = (1 - z sign(dx)) / delta",
        {presliding({0.02}),
         {.name = "load_share",
          .symbol = "a",
          .lower = 0.0,
          .upper = 0.9,
          .starts = {0.02},
          .sheet = {.what = "Friction over the force that presses: a = tanh(mu theta) of a capstan.",
                    .unit = "1",
                    .range = "Physics: it opposes the motion, so it is not negative; 0.9 is mu theta = 1.5, half a "
                             "turn at mu = 0.5.",
                    .errors =
                        "A force that hardly changes cannot separate it from dry friction of a constant size. Mistaken "
                        "for coulomb_friction and friction_with_pressure."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Loaded>(p[0], p[1]); },
        {.scales_specimen = true}}},
      {.unusual = true,
       .refines = "coulomb_friction",
       .needs_any_of = {"spring"},
       .acts_on = "friction element",
       .depends_on = {"direction", "load"},
       .shape_of = ShapeOf::kLoop,
       .words = "friction that grows with the load"}};
  return physics;
}

}  // namespace isorig::model::effect
