#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Polynomial : public Process {
 public:
  Polynomial(bool square, bool cube) noexcept : square_(square), cube_(cube) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double x = now.position_mm;
    if (square_) *columns++ = x * x;
    if (cube_) *columns = x * x * x;
  }

 private:
  bool square_;
  bool cube_;
};

class Exponential : public Process {
 public:
  explicit Exponential(double length_mm) noexcept : length_mm_(length_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double u = now.position_mm / length_mm_;
    columns[0] = length_mm_ * (std::expm1(u) - u);
  }

 private:
  double length_mm_;
};

class Knee : public Process {
 public:
  explicit Knee(double position_mm) noexcept : position_mm_(position_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::fmax(0.0, now.position_mm - position_mm_);
  }

 private:
  double position_mm_;
};

/// A knee that bends over a width: fibres that take up their load one after the other (a spread of lengths
/// that is logistic).
class SmoothKnee : public Process {
 public:
  SmoothKnee(double position_mm, double width_mm) noexcept : position_mm_(position_mm), width_mm_(width_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double u = (now.position_mm - position_mm_) / width_mm_;
    columns[0] = width_mm_ * (std::fmax(u, 0.0) + std::log1p(std::exp(-std::fabs(u))));
  }

 private:
  double position_mm_;
  double width_mm_;
};

}  // namespace

const Physics& strain_stiffening() {
  static const Physics physics{
      "strain_stiffening",
      Stage::kSpecimen,
      "Elastic force that is nonlinear in strain.",
      "Tondu 2012 (McKibben: stiffness grows with length); Fung 1967 (exponential). Fibres of "
      "spread slack lengths (Decraemer 1980). Linear and constant parts "
      "belong to the spring and the tare, so the position may be counted from anywhere.",
      "Slow triangle of the largest amplitude: the loading line is curved, the same at every velocity. "
      "Mistaken "
      "for a load cell that is not linear, which curves the relaxing part too.",
      {{"quadratic",
        "F = k x^2",
        {},
        {{"quadratic_N_mm2", Sign::kFree}},
        [](auto, const Reference&) { return std::make_unique<Polynomial>(true, false); }},
       {"cubic",
        "F = k x^3",
        {},
        {{"cubic_N_mm3", Sign::kFree}},
        [](auto, const Reference&) { return std::make_unique<Polynomial>(false, true); }},
       {"polynomial",
        "F = k2 x^2 + k3 x^3",
        {},
        {{"quadratic_N_mm2", Sign::kFree}, {"cubic_N_mm3", Sign::kFree}},
        [](auto, const Reference&) { return std::make_unique<Polynomial>(true, true); }},
       {"exponential",
        "F = k L (exp(x / L) - 1 - x / L)",
        {{"length_mm", 0.1, 100.0, {3.0}, true}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Exponential>(p[0]); }},
       {"knee",
        "F = k max(0, x - x0)",
        {{"position_mm", -1e3, 1e3, {-1.0, 1.0}}},
        {{"stiffness_N_mm", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Knee>(p[0]); }},
       {"smooth_knee",
        "F = k w ln(1 + exp((x - x0) / w))",
        {{"position_mm", -1e3, 1e3, {-1.0, 1.0}}, {"width_mm", 0.02, 20.0, {0.3, 0.3}, true}},
        {{"stiffness_N_mm", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<SmoothKnee>(p[0], p[1]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
