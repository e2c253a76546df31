#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Inertia : public Process {
 public:
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override { columns[0] = now.acceleration_mm_s2 * 1e-3; }
};

}  // namespace

const Physics& fixture_inertia() {
  static const Physics physics{
      "fixture_inertia",
      Stage::kRig,
      "Mass between specimen and load cell.",
      "Newton 1687; standard correction of dynamic load cells (ISO 4965-1:2012).",
      "The same motion with a rigid bar or with no specimen: what is left is the mass. Spikes at the corners "
      "of "
      "ramps, of opposite sign at start and stop.",
      {{"rigid",
        "F = m a",
        {},
        {{.name = "mass_kg",
          .symbol = "m",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Mass that moves with the crosshead on the specimen's side of the load cell.",
                    .unit = "kg",
                    .range = "Physics: a mass is not negative; no upper bound.",
                    .errors =
                        "The acceleration is the position differentiated twice: its noise biases the mass towards "
                        "zero. Mistaken for a ringing load train and, at the corners of ramps, for a lag."}}},
        [](auto, const Reference&) { return std::make_unique<Inertia>(); }}},
      {.acts_on = "mass",
       .depends_on = {"acceleration"},
       .shape_of = ShapeOf::kAcceleration,
       .words = "inertia of the fixture"}};
  return physics;
}

}  // namespace isorig::model::effect
