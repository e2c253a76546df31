#include <cmath>
#include <numbers>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Inertia : public Process {
 public:
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override { columns[0] = now.acceleration_mm_s2 * 1e-3; }
};

/// y'' = w^2 (a - y) - 2 z w y' for the acceleration y that the cell feels. Exact where a runs straight between
/// instants: with slope s the answer is a - 2 z s / w, and what is off it rings with w and dies with z w.
class SprungMass : public Process {
 public:
  SprungMass(double period_s, double damping) noexcept
      : w_(2.0 * std::numbers::pi / period_s), z_(damping), ringing_(w_ * std::sqrt(1.0 - z_ * z_)) {}
  void reset(const Instant& first) noexcept override {
    felt_ = input_ = first.acceleration_mm_s2;
    rate_ = 0.0;
  }
  void force(const Instant& now, double* columns) noexcept override {
    if (now.dt_s > 0.0) step(now.acceleration_mm_s2, now.dt_s);
    columns[0] = felt_ * 1e-3;
  }

 private:
  void step(double input, double dt_s) noexcept {
    if (dt_s != dt_s_) {  // readings mostly come evenly
      dt_s_ = dt_s;
      const double decay = std::exp(-z_ * w_ * dt_s);
      cosine_ = decay * std::cos(ringing_ * dt_s);
      sine_ = decay * (ringing_ > 0.0 ? std::sin(ringing_ * dt_s) / ringing_ : dt_s);
    }
    const double slope = (input - input_) / dt_s, behind = 2.0 * z_ * slope / w_;
    const double off = felt_ - (input_ - behind), off_rate = rate_ - slope;
    felt_ = input - behind + off * cosine_ + (z_ * w_ * off + off_rate) * sine_;
    rate_ = slope + off_rate * cosine_ - (w_ * w_ * off + z_ * w_ * off_rate) * sine_;
    input_ = input;
  }

  double w_;
  double z_;
  double ringing_;  ///< rad/s, of the damped mass
  double felt_ = 0.0;
  double rate_ = 0.0;
  double input_ = 0.0;
  double dt_s_ = 0.0;
  double cosine_ = 1.0;
  double sine_ = 0.0;
};

const Coefficient kMass{
    .name = "mass_kg",
    .symbol = "m",
    .sign = Sign::kNonNegative,
    .sheet = {.what = "Mass that moves with the crosshead on the specimen's side of the load cell.",
              .unit = "kg",
              .range = "Physics: a mass is not negative; no upper bound.",
              .errors = "The acceleration is the position differentiated twice: its noise biases the mass towards "
                        "zero. Mistaken for a ringing load train and, at the corners of ramps, for a lag."}};

}  // namespace

/// Mass m between specimen and load cell, which moves with the crosshead's acceleration a.
/// `rigid`: F = m a.
/// `sprung`: the mass hangs on a spring (grips, a coupling, the cell itself), with w = 2 pi / T and the share z of
/// critical damping,
///   F = m y,   y'' + 2 z w y' + w^2 y = w^2 a,   y(0) = a(0), y'(0) = 0
/// (one degree of freedom, Den Hartog 1934). For T to 0 it is the rigid mass; slow changes come late by
/// 2 z / w.
/// Units: m kg, a mm/s^2, F N (m a / 1000), T s, z 1. Range: m >= 0, T 2 ms to 0.5 s, z 0.02 to 1.
/// Errors: exact where a runs straight between instants; a is the position differentiated twice, over the interval that
/// its noise demands, so that a ringing faster than this is not seen.
/// Sources: ISO 4965-1:2012 (correction for the rigid mass); Den Hartog 1934, Mechanical Vibrations.
const Physics& fixture_inertia() {
  static const Physics physics{
      "fixture_inertia",
      Stage::kRig,
      "Mass between specimen and load cell.",
      "Newton 1687; standard correction of dynamic load cells (ISO 4965-1:2012); a mass on a spring: Den Hartog 1934, "
      "Mechanical Vibrations.",
      "The same motion with a rigid bar or with no specimen: what is left is the mass. Spikes at the corners "
      "of "
      "ramps, of opposite sign at start and stop.",
      {{"rigid", "F = m a", {}, {kMass}, [](auto, const Reference&) { return std::make_unique<Inertia>(); }},
       {"sprung",
        "F = m y, y'' + 2 z w y' + w^2 y = w^2 a, w = 2 pi / T",
        {{.name = "natural_period_s",
          .symbol = "T",
          .lower = 2e-3,
          .upper = 0.5,
          .starts = {0.03},
          .logarithmic = true,
          .traits = {.lower_limit_law = "rigid"},
          .sheet =
              {.what = "Time of one ringing of the mass on its spring without damping.",
               .unit = "s",
               .range =
                   "Instrument: at two intervals of 1 kHz the mass is rigid to the readings; a load train that takes "
                   "more than 0.5 s swings visibly.",
               .errors = "Shows in the milliseconds behind the corners of ramps alone, where the position is "
                         "differentiated twice. Mistaken for a lag or a dead time of the force channel."}},
         {.name = "damping",
          .symbol = "z",
          .lower = 0.02,
          .upper = 1.0,
          .starts = {0.4},
          .logarithmic = true,
          .traits = {.upper_limit_law = "a load train that does not ring"},
          .sheet = {.what = "Damping of that ringing as a share of what would suppress it.",
                    .unit = "1",
                    .range =
                        "Instrument: bolted joints have 0.02 and more; Numerics: above 1 the mass only comes late, by "
                        "2 z / w, which a longer period does as well.",
                    .errors = "Only its product with the period is known where the readings are slower than the "
                              "ringing. Mistaken for a lag of the force channel."}}},
        {kMass},
        [](std::span<const double> p, const Reference&) { return std::make_unique<SprungMass>(p[0], p[1]); }}},
      {.acts_on = "mass",
       .depends_on = {"acceleration"},
       .shape_of = ShapeOf::kAcceleration,
       .words = "inertia of the fixture"}};
  return physics;
}

}  // namespace isorig::model::effect
