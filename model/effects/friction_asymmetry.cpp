#include <cmath>

#include "model/effects/effects.hpp"
#include "model/effects/presliding.hpp"

namespace isorig::model::effect {
namespace {

/// What friction and drag differ by between extension and shortening; bristle as in coulomb_friction. Beside
/// a symmetric friction Fc and a dashpot c: F+ = Fc + d and F- = Fc - d, c+ = c + e and c- = c - e.
class Asymmetric : public Process {
 public:
  Asymmetric(bool sliding, bool viscous, double presliding_mm) noexcept
      : sliding_(sliding), viscous_(viscous), bristle_(presliding_mm) {}
  void reset(const Instant&) noexcept override { bristle_.reset(); }
  void force(const Instant& now, double* columns) noexcept override {
    const double z = bristle_.slide(now.slide_mm);
    if (sliding_) *columns++ = std::fabs(z);
    if (viscous_) *columns = std::fabs(now.velocity_mm_s);
  }

 private:
  bool sliding_;
  bool viscous_;
  DahlBristle bristle_;
};

const Parameter kAsymmetryPresliding = presliding({0.02});
const Coefficient kSlidingHalf{
    .name = "force_half_difference_N",
    .symbol = "d",
    .sign = Sign::kFree,
    .sheet = {
        .what = "Half of what sliding friction is more in extension than in shortening; positive: more in extension.",
        .unit = "N",
        .range = "Physics: either direction may rub more, so it has no sign; it cannot exceed the symmetric friction "
                 "without driving the motion, which is not enforced.",
        .errors = "An offset of the force, where the motion never rests. Mistaken for a tare."}};
const Coefficient kViscousHalf{
    .name = "viscosity_half_difference_N_s_mm",
    .symbol = "e",
    .sign = Sign::kFree,
    .sheet = {.what = "Half of what viscous drag is more in extension than in shortening; positive: more in extension.",
              .unit = "N s/mm",
              .range = "Physics: either direction may drag more, so it has no sign; it cannot exceed the symmetric "
                       "drag without driving the motion, which is not enforced.",
              .errors = "Ramps in one direction only leave it undetermined. Mistaken for strain stiffening where speed "
                        "and position go together."}};

}  // namespace

const Physics& friction_asymmetry() {
  static const Physics physics{
      "friction_asymmetry",
      Stage::kSpecimen,
      "Friction that differs between extension and shortening.",
      "Canudas de Wit, Astrom & Braun 1987, IEEE J. Robot. Autom. 3:681 (friction with other coefficients in each "
      "direction).",
      "Slow triangles at several velocities in both directions. Where the motion never rests, the difference "
      "of "
      "the sliding forces cannot be told from an offset of the force.",
      {{"viscous",
        "F = e |v|, beside a dashpot: c+ = c + e, c- = c - e",
        {},
        {kViscousHalf},
        [](auto, const Reference&) { return std::make_unique<Asymmetric>(false, true, 1.0); }},
       {"sliding",
        "F = d |z|, dz/dx = (1 - z sign(dx)) / delta; beside friction F+ = Fc + d, F- = Fc - d",
        {kAsymmetryPresliding},
        {kSlidingHalf},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Asymmetric>(true, false, p[0]); }},
       {"both",
        "F = d |z| + e |v|, dz/dx = (1 - z sign(dx)) / delta",
        {kAsymmetryPresliding},
        {kSlidingHalf, kViscousHalf},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Asymmetric>(true, true, p[0]); }}},
      {.unusual = true,
       .refines = "coulomb_friction",
       .acts_on = "friction element",
       .depends_on = {"direction", "rate"},
       .shape_of = ShapeOf::kRate,
       .words = "friction that differs by direction"}};
  return physics;
}

}  // namespace isorig::model::effect
