#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// Friction and drag that differ between extension and shortening; bristle as in coulomb_friction.
class Asymmetric : public Process {
 public:
  explicit Asymmetric(double presliding_mm) noexcept : presliding_mm_(presliding_mm) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    const double s = sign_of(now.slide_mm);
    if (s != 0.0) z_ = s + (z_ - s) * std::exp(-std::fabs(now.slide_mm) / presliding_mm_);
    columns[0] = std::fmax(z_, 0.0);
    columns[1] = std::fmin(z_, 0.0);
    columns[2] = std::fabs(now.velocity_mm_s);
  }

 private:
  double presliding_mm_;
  double z_ = 0.0;
};

}  // namespace

const Physics& friction_asymmetry() {
  static const Physics physics{
      "friction_asymmetry",
      Stage::kSpecimen,
      "Friction that differs between extension and shortening.",
      "Worn ball screws (Janot, Gautier & Brunot 2019, EMPS); braids (Tondu 2006).",
      "Slow triangles at several velocities in both directions.",
      {{"dahl",
        "F = F+ max(z, 0) + F- min(z, 0) + c |v|",
        {{"presliding_mm", 2e-4, 1.0, {0.02}, true}},
        {{"extending_N", Sign::kNonNegative},
         {"shortening_N", Sign::kNonNegative},
         {"viscosity_difference_N_s_mm", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Asymmetric>(p[0]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
