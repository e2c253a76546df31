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

/// Extension that ends: F = k L u^2 / (1 - u), u = x / L. A braid locks where its fibres lie side by side and their
/// angle to the axis is the least (Chou & Hannaford 1996); near a limit of extension the force goes as one over the
/// distance to it (Gent 1996). In small extension it is k x^2 / L, k in N/mm. L in mm from the rest position; what was
/// passed was not the lock, so a fit's L lies beyond the largest position. Up to 0.99 of L; beyond that the force stays
/// as it is there, since no braid is.
class Lock : public Process {
 public:
  explicit Lock(double lock_mm) noexcept : lock_mm_(lock_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    constexpr double kNearest = 0.99;
    const double u = std::fmin(now.position_mm / lock_mm_, kNearest);
    columns[0] = lock_mm_ * u * u / (1.0 - u);
  }

 private:
  double lock_mm_;
};

}  // namespace

const Physics& strain_stiffening() {
  static const Physics physics{
      "strain_stiffening",
      Stage::kSpecimen,
      "Elastic force that is nonlinear in strain.",
      "Tondu 2012 (McKibben: stiffness grows with length); Fung 1967 (exponential). Fibres of "
      "spread slack lengths (Decraemer 1980). A braid locks (Chou & Hannaford 1996), with a force as near any limit of "
      "extension (Gent 1996). Linear and constant parts "
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
        [](std::span<const double> p, const Reference&) { return std::make_unique<SmoothKnee>(p[0], p[1]); }},
       {"lock",
        "F = k L u^2 / (1 - u), u = x / L",
        {{"lock_mm", 0.5, 1e3, {8.0, 60.0}, true}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Lock>(p[0]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
