#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// What friction and drag differ by between extension and shortening; bristle as in coulomb_friction. Beside
/// a symmetric friction Fc and a dashpot c: F+ = Fc + d and F- = Fc - d, c+ = c + e and c- = c - e.
class Asymmetric : public Process {
 public:
  Asymmetric(bool sliding, bool viscous, double presliding_mm) noexcept
      : sliding_(sliding), viscous_(viscous), presliding_mm_(presliding_mm) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    const double s = sign_of(now.slide_mm);
    if (s != 0.0) z_ = s + (z_ - s) * std::exp(-std::fabs(now.slide_mm) / presliding_mm_);
    if (sliding_) *columns++ = std::fabs(z_);
    if (viscous_) *columns = std::fabs(now.velocity_mm_s);
  }

 private:
  bool sliding_;
  bool viscous_;
  double presliding_mm_;
  double z_ = 0.0;
};

const Coefficient kSlidingHalf{"force_half_difference_N", Sign::kFree};
const Coefficient kViscousHalf{"viscosity_half_difference_N_s_mm", Sign::kFree};

}  // namespace

const Physics& friction_asymmetry() {
  static const Physics physics{
      "friction_asymmetry",
      Stage::kSpecimen,
      "Friction that differs between extension and shortening.",
      "Worn ball screws (Janot, Gautier & Brunot 2019, EMPS); braids (Tondu 2006).",
      "Slow triangles at several velocities in both directions. Where the motion never rests, the difference "
      "of "
      "the sliding forces cannot be told from an offset of the force.",
      {{"viscous",
        "F = e |v|, beside a dashpot: c+ = c + e, c- = c - e",
        {},
        {kViscousHalf},
        [](auto, const Reference&) { return std::make_unique<Asymmetric>(false, true, 1.0); }},
       {"sliding",
        "F = d |z|, z as Dahl, beside friction: F+ = Fc + d, F- = Fc - d",
        {{"presliding_mm", 2e-4, 1.0, {0.02}, true, false, {.lower_limit_law = "ideal dry friction"}}},
        {kSlidingHalf},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Asymmetric>(true, false, p[0]); }},
       {"both",
        "F = d |z| + e |v|",
        {{"presliding_mm", 2e-4, 1.0, {0.02}, true, false, {.lower_limit_law = "ideal dry friction"}}},
        {kSlidingHalf, kViscousHalf},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Asymmetric>(true, true, p[0]); }}},
      {.unusual = true, .refines = "coulomb_friction"}};
  return physics;
}

}  // namespace isorig::model::effect
