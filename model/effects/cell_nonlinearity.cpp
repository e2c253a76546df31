#include <cmath>

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

/// F_read = F / (1 + (|F| / c)^n)^(1 / n): linear below the ceiling c, which no reading passes.
class Ceiling : public Process {
 public:
  Ceiling(double ceiling_N, double sharpness) noexcept
      : ceiling_N_(ceiling_N), sharpness_(sharpness), linear_share_(std::exp(std::log(kLinear) / sharpness)) {}
  void reset(const Instant&) noexcept override {}
  void shape(const Instant&, std::span<double> columns, std::span<const double> coefficients) noexcept override {
    double force_N = 0.0;
    for (std::size_t i = 0; i < columns.size(); ++i) force_N += columns[i] * coefficients[i];
    const double share = std::fabs(force_N) / ceiling_N_;
    if (share <= linear_share_) return;
    // Above the ceiling with the power taken out, so that share^n does not overflow.
    const double power = std::exp(-sharpness_ * std::fabs(std::log(share)));
    const double read = corner(power) / std::fmax(share, 1.0);
    for (double& column : columns) column *= read;
  }

 private:
  /// (1 + p)^(-1 / n); by series where p is small, which it is for nearly all readings. Relative error below 2e-16.
  [[nodiscard]] double corner(double power) const noexcept {
    constexpr double kSmall = 1e-3;
    if (power > kSmall) return std::exp(-std::log1p(power) / sharpness_);
    const double p = power, log_1p = p * (1.0 - p * (1.0 / 2 - p * (1.0 / 3 - p * (1.0 / 4 - p * (1.0 / 5)))));
    const double x = log_1p / sharpness_;
    return 1.0 - x * (1.0 - x * (1.0 / 2 - x * (1.0 / 6 - x * (1.0 / 24 - x * (1.0 / 120)))));
  }

  static constexpr double kLinear = 1e-13;  ///< share^n that the reading is linear for
  double ceiling_N_, sharpness_, linear_share_;
};

}  // namespace

const Physics& cell_nonlinearity() {
  static const Physics physics{
      "cell_nonlinearity",
      Stage::kSensorLag,
      "A load cell whose reading is not linear in force.",
      "Second-order term of a load cell's calibration (ISO 376:2011); ceiling of an amplifier, rounded (Rapp 1991).",
      "Dead weights over the range, no specimen. Mistaken for strain stiffening; relaxation in holds tells "
      "them apart. A ceiling shows where different motions reach it: all forces end there.",
      {{"quadratic",
        "F' = F (1 + q F)",
        {{.name = "curvature_1_kN",
          .symbol = "q",
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
        {.uses_coefficients = true}},
       {"ceiling",
        "F' = F / (1 + (|F| / c)^n)^(1 / n)",
        {{.name = "ceiling_N",
          .symbol = "c",
          .lower = 0.01,
          .upper = 1e5,
          .starts = {0.99, 1.0, 1.05, 1.3},
          .logarithmic = true,
          .traits = {.starts_are_shares_of_largest_force = true},
          .sheet = {.what = "Force that no reading passes, in either direction.",
                    .unit = "N",
                    .range = "Instrument: from cells of a tenth of a newton to frames of 100 kN; a search begins at "
                             "the largest force that was read.",
                    .errors = "Known to within the noise where holds reach it, and hardly beyond 1.5 times the largest "
                              "force read. A tare that is set after the amplifier shifts it by itself."}},
         {.name = "sharpness",
          .symbol = "n",
          .lower = 1.5,
          .upper = 1000.0,
          .starts = {150.0, 60.0, 25.0, 6.0},
          .logarithmic = true,
          .traits = {.upper_limit_law = "a hard limit"},
          .sheet = {.what = "Exponent n of the corner: at the ceiling's own force a reading lacks 1 - 2^(-1/n) of it.",
                    .unit = "1",
                    .range = "Numerics: at 1000 the corner is 0.1 % wide, a hard limit at the resolution of most "
                             "cells; below 1.5 no range is left in which the cell is linear.",
                    .errors = "Correlated with the ceiling where no reading comes within a tenth of it. Mistaken for "
                              "softening with strain where force and position go together."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Ceiling>(p[0], p[1]); },
        {.uses_coefficients = true}}},
      {.unusual = true,
       .acts_on = "force channel",
       .depends_on = {"load"},
       .shape_of = ShapeOf::kLoad,
       .words = "a load cell that is not linear"}};
  return physics;
}

}  // namespace isorig::model::effect
