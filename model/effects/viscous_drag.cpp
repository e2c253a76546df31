#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Drag : public Process {
 public:
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override { columns[0] = now.velocity_mm_s; }
};

}  // namespace

const Physics& viscous_drag() {
  static const Physics physics{
      "viscous_drag",
      Stage::kSpecimen,
      "Linear dashpot in parallel: air through the fitting, a greased guide.",
      "Newton 1687 (resistance in proportion to the rate of shear).",
      "Steps of force in proportion to the velocity at both corners of a ramp. Nearly a force that leads "
      "(a negative dead time), nearly a very fast relaxation.",
      {{"linear",
        "F = c v",
        {},
        {{.name = "viscosity_N_s_mm",
          .symbol = "c",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Drag force for each mm/s of speed.",
                    .unit = "N s/mm",
                    .range = "Physics: drag dissipates, so it is not negative; no upper bound.",
                    .errors = "A force channel that is late by d takes k d from it, k the stiffness. Mistaken for a "
                              "relaxation faster than the sampling."}}},
        [](auto, const Reference&) { return std::make_unique<Drag>(); }}},
      {.unusual = true,
       .acts_on = "dashpot",
       .depends_on = {"rate"},
       .shape_of = ShapeOf::kRate,
       .words = "viscous drag"}};
  return physics;
}

}  // namespace isorig::model::effect
