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
      "Newton; standard correction of dynamic load cells (ISO 4965).",
      "The same motion with a rigid bar or with no specimen: what is left is the mass. Spikes at the corners "
      "of "
      "ramps, of opposite sign at start and stop.",
      {{"rigid", "F = m a", {}, {{"mass_kg", Sign::kNonNegative}}, [](auto, const Reference&) {
          return std::make_unique<Inertia>();
        }}}};
  return physics;
}

}  // namespace isorig::model::effect
