#include <algorithm>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Threshold : public Process {
 public:
  Threshold(double threshold_psi, double nominal_psi) noexcept
      : threshold_psi_(threshold_psi), nominal_psi_(nominal_psi) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::max(0.0, now.excess_pressure_psi + nominal_psi_ - threshold_psi_);
  }

 private:
  double threshold_psi_;
  double nominal_psi_;
};

}  // namespace

const Physics& pressure_threshold() {
  static const Physics physics{
      "pressure_threshold",
      Stage::kSpecimen,
      "A muscle that pulls only beyond the pressure that has straightened its bladder and laid it on the "
      "braid.",
      "Threshold pressure of McKibben muscles: Chou & Hannaford 1996; Klute & Hannaford 2000.",
      "Fill slowly at a fixed length: the force stands still, then rises in proportion to the pressure.",
      {{"dead_zone",
        "F = f max(0, p - pt), beside what is linear in the pressure",
        {{"threshold_psi", 0.01, 300.0, {10.0, 40.0}, true}},
        {{"force_N_psi", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Threshold>(p[0], reference.nominal_pressure_psi);
        }}},
      {.unusual = true, .pressure = PressureNeed::kVaries, .driven_by_pressure = true}};
  return physics;
}

}  // namespace isorig::model::effect
