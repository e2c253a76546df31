#include <cmath>

#include "model/effects/effects.hpp"
#include "model/effects/presliding.hpp"

namespace isorig::model::effect {
namespace {

class Pressed : public Process {
 public:
  Pressed(double presliding_mm, double nominal_psi) noexcept : bristle_(presliding_mm), nominal_psi_(nominal_psi) {}
  void reset(const Instant&) noexcept override { bristle_.reset(); }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = bristle_.slide(now.slide_mm) * (now.excess_pressure_psi + nominal_psi_);
  }

 private:
  DahlBristle bristle_;
  double nominal_psi_;
};

}  // namespace

const Physics& friction_with_pressure() {
  static const Physics physics{
      "friction_with_pressure",
      Stage::kSpecimen,
      "Friction that grows with the pressure on seal or braid.",
      "Tondu & Lopez 2000, IEEE Control Syst. Mag. 20(2):15 (thread against thread, pressed by the muscle's pressure); "
      "seals of "
      "pneumatic cylinders: Belforte, D'Alfio & Raparelli 1989, J. Fluid Control 20(1):42.",
      "Slow triangles at every pressure.",
      {{"dahl",
        "F = f p z, dz/dx = (1 - z sign(dx)) / delta; beside friction (Fc + f p) z",
        {presliding({0.02})},
        {{.name = "force_N_psi",
          .symbol = "f",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Sliding friction that each psi of gauge pressure adds.",
                    .unit = "N/psi",
                    .range = "Physics: pressure presses the surfaces together, so it is not negative; no upper bound.",
                    .errors = "A pressure that hardly varies leaves it undetermined beside the friction at any "
                              "pressure. Mistaken for coulomb_friction."}}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Pressed>(p[0], reference.nominal_pressure_psi);
        }}},
      {.unusual = true,
       .refines = "coulomb_friction",
       .pressure = PressureNeed::kVaries,
       .acts_on = "friction element",
       .depends_on = {"direction", "pressure"},
       .shape_of = ShapeOf::kPressure,
       .words = "friction that grows with pressure"}};
  return physics;
}

}  // namespace isorig::model::effect
