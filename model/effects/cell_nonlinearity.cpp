#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// F_read = F (1 + q F), applied to the sum and written back to the columns in proportion.
class Curved : public Process {
 public:
  explicit Curved(double per_kN) noexcept : per_N_(per_kN * 1e-3) {}
  void reset(const Instant&) noexcept override {}
  void shape(const Instant&, std::span<double> columns, std::span<const double> coefficients) noexcept override {
    double force_N = 0.0;
    for (std::size_t i = 0; i < columns.size(); ++i) force_N += columns[i] * coefficients[i];
    for (double& column : columns) column *= 1.0 + per_N_ * force_N;
  }

 private:
  double per_N_;
};

}  // namespace

const Physics& cell_nonlinearity() {
  static const Physics physics{
      "cell_nonlinearity",
      Stage::kSensorLag,
      "A load cell whose reading is not linear in force.",
      "Second-order term of a load cell's calibration (ISO 376:2011).",
      "Dead weights over the range, no specimen. Mistaken for strain stiffening; relaxation in holds tells "
      "them apart.",
      {{"quadratic",
        "F' = F (1 + q F)",
        {{.name = "curvature_1_kN",
          .lower = -20.0,
          .upper = 20.0,
          .starts = {0.5, -0.5},
          .sheet = {.what = "Share by which the reading of the cell grows per kN of force; positive: it reads too much "
                            "at both ends, by q F^2.",
                    .unit = "1/kN",
                    .range = "Numerics: at 20 per kN a reading still rises with the force up to 25 N; a cell of 250 N "
                             "that is linear to 0.1 % has 0.004 per kN.",
                    .errors = "An offset of the tare shifts it, since the curve is counted from the zero of the model. "
                              "Mistaken for strain stiffening when the record has no hold."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Curved>(p[0]); },
        {.uses_coefficients = true}}},
      {.unusual = true}};
  return physics;
}

}  // namespace isorig::model::effect
