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
      "Second-order term of a load cell's calibration (ISO 376).",
      "Dead weights over the range, no specimen. Mistaken for strain stiffening; relaxation in holds tells "
      "them apart.",
      {{"quadratic",
        "F' = F (1 + q F)",
        {{"curvature_1_kN", -20.0, 20.0, {0.5, -0.5}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Curved>(p[0]); },
        {.uses_coefficients = true}}},
      {.unusual = true}};
  return physics;
}

}  // namespace isorig::model::effect
