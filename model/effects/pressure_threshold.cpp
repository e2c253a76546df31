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
        {{.name = "threshold_psi",
          .symbol = "pt",
          .lower = 0.01,
          .upper = 300.0,
          .starts = {10.0, 40.0},
          .logarithmic = true,
          .sheet = {.what = "Gauge pressure below which the muscle does not pull.",
                    .unit = "psi",
                    .range = "Instrument: 0.01 psi is within the zero error of every pressure channel; 300 psi is "
                             "beyond what pneumatic muscles are filled with.",
                    .errors = "An offset of the pressure channel shifts it by as much. Undetermined where the pressure "
                              "never falls below it. Mistaken for friction of the braid while filling."}}},
        {{.name = "force_N_psi",
          .symbol = "f",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Force that each psi above the threshold adds.",
                    .unit = "N/psi",
                    .range = "Physics: beyond the threshold the braid turns pressure into pull, so it is not negative; "
                             "no upper bound.",
                    .errors = "A pressure that hardly passes the threshold cannot separate it from it. Mistaken for "
                              "pressure_coupling."}}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Threshold>(p[0], reference.nominal_pressure_psi);
        }}},
      {.unusual = true,
       .pressure = PressureNeed::kVaries,
       .driven_by_pressure = true,
       .acts_on = "pressure path",
       .depends_on = {"pressure"},
       .shape_of = ShapeOf::kPressure,
       .words = "a pressure below which nothing happens"}};
  return physics;
}

}  // namespace isorig::model::effect
