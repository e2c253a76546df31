#include <algorithm>
#include <cmath>

#include "model/braid.hpp"
#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// First-order lag y of an input u, tau dy/dt = u - y, over steps of equal length in which the input is a parabola:
/// exact for such an input.
class ParabolaLag {
 public:
  ParabolaLag(double dt_s, double time_constant_s) noexcept
      : constant_(-std::expm1(-dt_s / time_constant_s)),
        straight_(1.0 - constant_ * time_constant_s / dt_s),
        square_(1.0 - 2.0 * straight_ * time_constant_s / dt_s) {}
  /// The output at the step's end, from the output at its begin and the input at its begin, middle and end.
  [[nodiscard]] double next(double output, double begin, double middle, double end) const noexcept {
    return output + constant_ * (begin - output) + straight_ * (4.0 * middle - 3.0 * begin - end) +
           square_ * 2.0 * (begin - 2.0 * middle + end);
  }

 private:
  double constant_, straight_, square_;  // answers to inputs 1, s and s^2, s from 0 to 1 in the step
};

/// Air in a braid behind a valve. What is stepped is its content m = P V^kappa, which motion alone leaves as it is:
/// tau dm/dt = p V^kappa - m, a lag whose input is smooth in the length and straight in the measured pressure.
class Chamber : public Process {
 public:
  Chamber(double time_constant_s, double braid_angle_deg, double exponent, double rest_length_mm,
          double nominal_psi) noexcept
      : tau_s_(time_constant_s),
        exponent_(exponent),
        rest_mm_(rest_length_mm),
        nominal_psi_(nominal_psi + kAtmosphere_psi),
        braid_(rest_length_mm, 1.0, braid_angle_deg),
        volume_(1.0 / braid_.volume_mm3(rest_length_mm)),
        slope_(1.0 / braid_.slope_mm2(rest_length_mm)) {}
  void reset(const Instant& first) noexcept override {
    length_mm_ = length(first);
    outside_psi_ = nominal_psi_ + first.excess_pressure_psi;
    power_ = power(length_mm_);
    content_ = outside_psi_ * power_;
  }
  void force(const Instant& now, double* columns) noexcept override {
    const double to_mm = length(now), to_psi = nominal_psi_ + now.excess_pressure_psi;
    if (now.dt_s > 0.0) {
      flow(to_mm, to_psi, now.dt_s);
    } else if (to_mm != length_mm_) {
      power_ = power(to_mm);
    }
    length_mm_ = to_mm;
    outside_psi_ = to_psi;
    columns[0] = slope_ * braid_.slope_mm2(length_mm_) * (content_ / power_ - outside_psi_);
  }

 private:
  /// A braid lengthens no further than its threads, and does not vanish.
  [[nodiscard]] double length(const Instant& now) const noexcept {
    constexpr double kShortest = 0.05, kLongest = 0.99;  // of the threads' length
    return std::clamp(rest_mm_ + now.position_mm, kShortest * braid_.thread_mm(), kLongest * braid_.thread_mm());
  }
  [[nodiscard]] double power(double length_mm) const noexcept {
    return std::pow(volume_ * braid_.volume_mm3(length_mm), exponent_);
  }
  /// Over parts of a two-hundredth of the length the input differs from a parabola by less than 1e-7 of itself.
  void flow(double to_mm, double to_psi, double dt_s) noexcept {
    constexpr double kPart = 0.005, kMostParts = 1000.0;
    const double moved_mm = to_mm - length_mm_, rise_psi = to_psi - outside_psi_;
    const double parts = std::clamp(std::ceil(std::fabs(moved_mm) / (kPart * rest_mm_)), 1.0, kMostParts);
    const ParabolaLag lag(dt_s / parts, tau_s_);
    const auto psi = [&](double part) { return outside_psi_ + rise_psi * part / parts; };
    for (double part = 0.0; part < parts; part += 1.0) {
      double middle = power_, end = power_;
      if (moved_mm != 0.0) {
        middle = power(length_mm_ + moved_mm * (part + 0.5) / parts);
        end = power(length_mm_ + moved_mm * (part + 1.0) / parts);
      }
      content_ = lag.next(content_, psi(part) * power_, psi(part + 0.5) * middle, psi(part + 1.0) * end);
      power_ = end;
    }
  }

  double tau_s_;
  double exponent_;
  double rest_mm_;
  double nominal_psi_;  // absolute, as all pressures here
  Braid braid_;
  double volume_;  // one over that at the rest length
  double slope_;   // one over dV/dL there
  double length_mm_ = 0.0;
  double outside_psi_ = 0.0;
  double power_ = 1.0;  // V^kappa at length_mm_
  double content_ = 0.0;
};

}  // namespace

/// Gas that a valve or a narrow tube keeps in the actuator. When the crosshead moves, the chamber changes its volume V
/// and with it the pressure P inside, which the gauge at the regulator does not show and which flows back through the
/// valve. With p the measured pressure, both absolute, the gas adds what the gauge does not show:
///
///     dP/dt = -kappa P V'(L) v / V(L) + (p - P) / tau,   F = f g (P - p),   g = V'(L) / V'(L0),   f = -V'(L0)
///
/// What the measured pressure does to the force is pressure_coupling, beside it or without it.
/// V(L) is that of a braid of inextensible threads b (Chou & Hannaford 1996, model/braid.hpp), so that a muscle pulls
/// with -V' for each psi. Signs: extension and tension positive; f >= 0, since below the neutral angle of 54.7 degrees
/// a muscle that is stretched loses volume and pulls harder. In strokes that are short against the length it is a
/// Maxwell arm of stiffness kappa p V'^2 / V (second_relaxation): the braid's curve and the pressure's own changes
/// alone tell the two apart, which the price of `contains` is for.
///   tau = 0           a valve that lets everything through: no force; while it still adds some, viscous_drag
///   tau without end   a valve that is shut: an elastic force that is curved as the gas is, strain_stiffening
/// Units: tau s, theta degrees, f N/psi. kappa is 1 where the walls keep the gas at their temperature (isothermal) and
/// 1.4 where they have no time to (adiabatic). It is told from f and theta where the stroke is long enough for the
/// volume to curve: at 4 mm of 90 mm it is recovered, at 4 mm of 9 m its interval is its whole range (recovery_test).
/// Errors: exact for straight motion and pressure to 1e-6. The air of the tube and of the end caps is not in V: it
/// makes f smaller by its share of the volume, and the angle larger. Flow is in proportion to the difference of
/// pressure, as through a narrow tube; an orifice chokes. Passive at a constant measured pressure.
/// Sources: Chou & Hannaford 1996, IEEE Trans. Robot. Autom. 12:90 (volume, force); Doumit & Pardoel 2017, Mech. Syst.
/// Signal Process. 91:93 (polytropic gas and valve of a muscle in motion); Kagawa 1985 (heat of the walls); Richer &
/// Hurmuzlu 2000 (tube).
const Physics& trapped_gas() {
  static const Physics physics{
      "trapped_gas",
      Stage::kSpecimen,
      "Gas that a valve or a narrow tube keeps in the specimen, compressed by the motion.",
      "Chou & Hannaford 1996 (volume and force of a braid); Doumit & Pardoel 2017, Mech. Syst. Signal Process. 91:93 "
      "(polytropic gas and valve flow of a muscle in motion); Kagawa 1985 (heat of the walls); Richer & Hurmuzlu 2000 "
      "(tube).",
      "The same ramp with its hold, valve open and valve shut, at the ends of the stroke and in the middle. Mistaken "
      "for a second relaxation, which it is in strokes that are short against the length; with the valve shut for "
      "strain stiffening, with a wide valve for viscous drag.",
      {{"polytropic",
        "F = f g (P - p), d(P V^kappa)/dt = (p - P) V^kappa / tau, V = L (b^2 - L^2), g = V'(L) / V'(L0), L = L0 + x, "
        "b = L0 / cos(theta)",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 0.01,
          .upper = 1000.0,
          .starts = {0.3, 5.0},
          .logarithmic = true,
          .traits = {.lower_bound_is = "viscous_drag", .upper_bound_is = "strain_stiffening"},
          .sheet = {.what = "Time in which the pressure inside has gone 63 % of the way to the measured one.",
                    .unit = "s",
                    .range =
                        "Physics: volume times flow resistance of valve and tube; at 10 ms the gas is a dashpot at "
                        "every speed of the rig, and a valve that takes a quarter of an hour is shut.",
                    .errors = "A hold shorter than it cannot separate it from a valve that is shut. Mistaken for the "
                              "time constant of a Maxwell arm."}},
         {.name = "braid_angle_deg",
          .symbol = "theta",
          .lower = 20.0,
          .upper = 45.0,
          .starts = {30.0},
          .sheet = {.what = "Angle between thread and axis at the rest length: how the volume curves with the length.",
                    .unit = "deg",
                    .range = "Physics: near 20 degrees a braid locks; from 45 on it could shorten by less than a fifth "
                             "before the neutral angle (54.7), where its volume no longer changes with its length.",
                    .errors = "Strokes short against the length leave it undetermined; air in the tube makes it "
                              "larger. Around 40 degrees the curves of volume and lever even out. Mistaken for strain "
                              "stiffening."}},
         {.name = "exponent",
          .symbol = "kappa",
          .lower = 1.0,
          .upper = 1.4,
          .starts = {1.2},
          .traits = {.lower_limit_law = "an isothermal gas", .upper_limit_law = "an adiabatic gas"},
          .sheet = {.what = "Exponent of the compression: pressure times volume to this power stays in a shut chamber.",
                    .unit = "1",
                    .range = "Physics: 1 where the walls keep the temperature of the gas, 1.4 (air) where the motion "
                             "leaves them no time.",
                    .errors = "Strokes short against the length leave it undetermined with the angle, and only its "
                              "product with the force is known. One exponent for every speed: heat that the walls take "
                              "up during the recording makes it a mean."}},
         {.name = "rest_length_mm",
          .symbol = "L0",
          .lower = 1.0,
          .upper = 1e4,
          .starts = {90.0},
          .logarithmic = true,
          .fixed = true,
          .traits = {.filled_by = FilledBy::kRestLength},
          .sheet = {.what = "Length of the specimen at position zero, without pressure.",
                    .unit = "mm",
                    .range = "Physics: from the shortest to the longest muscle that a frame takes.",
                    .errors = "Filled in from the recording; where that states a wrong length, the angle is wrong."}}},
        {{.name = "force_N_psi",
          .symbol = "f",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Force that each psi inside adds at the rest length; the rate at which it loses volume.",
                    .unit = "N/psi",
                    .range = "Physics: below the neutral angle a chamber that is stretched loses volume, so it is not "
                             "negative; no upper bound.",
                    .errors = "Air in the tube makes it smaller by its share of the volume, the exponent by a sixth. "
                              "Ramps slower than the valve show only its product with the time constant. Mistaken for "
                              "the stiffness of a Maxwell arm."}}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Chamber>(p[0], p[1], p[2], p[3], reference.nominal_pressure_psi);
        }}},
      {.unusual = true,
       .contains = {"second_relaxation"},
       .needs_any_of = {"spring"},
       .pressure = PressureNeed::kStill,
       .acts_on = "pressure path",
       .depends_on = {"hold", "rate", "strain", "pressure"},
       .shape_of = ShapeOf::kStep,
       .words = "gas trapped in the specimen"}};
  return physics;
}

}  // namespace isorig::model::effect
