#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

class Coupling : public Process {
 public:
  Coupling(bool force, bool stiffness) noexcept : force_(force), stiffness_(stiffness) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    if (force_) *columns++ = now.excess_pressure_psi;
    if (stiffness_) *columns = now.excess_pressure_psi * now.elongation_mm;
  }

 private:
  bool force_;
  bool stiffness_;
};

/// The pressure inside the specimen behind its tube: tau dq/dt = (p - p0) - q, q = p - p0 at the start. Exact when the
/// measured pressure runs straight between instants.
class BehindTube : public Process {
 public:
  explicit BehindTube(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant& first) noexcept override { inside_psi_ = measured_psi_ = first.excess_pressure_psi; }
  void force(const Instant& now, double* columns) noexcept override {
    if (now.dt_s > 0.0) {
      inside_psi_ = StraightLag(now.dt_s, tau_s_).next(inside_psi_, measured_psi_, now.excess_pressure_psi);
      measured_psi_ = now.excess_pressure_psi;
    }
    *columns = inside_psi_;
  }

 private:
  double tau_s_;
  double inside_psi_ = 0.0;
  double measured_psi_ = 0.0;
};

const Coefficient kForcePerPsi{
    .name = "force_N_psi",
    .symbol = "f'",
    .sign = Sign::kFree,
    .sheet = {
        .what = "Force that each psi above the nominal pressure adds, at the pressurized "
                "rest length; positive: it pulls more.",
        .unit = "N/psi",
        .range =
            "Physics: more pressure makes a McKibben pull where its threads lie less than "
            "54.7 degrees (the neutral angle) from the axis and push beyond, so either sign can be. Refused where the "
            "nominal pressure would add more than 20 times the largest force read.",
        .errors = "A pressure that varies only with the motion cannot separate it from viscosity; "
                  "a late pressure channel biases it. Mistaken for viscous drag."}};
const Coefficient kStiffnessPerPsi{
    .name = "stiffness_N_mm_psi",
    .symbol = "k'",
    .sign = Sign::kFree,
    .sheet = {
        .what = "Stiffness that each psi above the nominal pressure adds; positive: stiffer.",
        .unit = "N/mm/psi",
        .range =
            "Physics: stiffness may grow or fall with pressure, by the braid angle, so it has no sign. Refused where "
            "the nominal pressure would add more than 20 times the largest force read.",
        .errors = "A pressure that varies only with the motion cannot separate it from viscosity; a wrong zero of the "
                  "elongation moves part of it into the force per psi. Mistaken for strain stiffening."}};

}  // namespace

const Physics& pressure_coupling() {
  static const Physics physics{
      "pressure_coupling",
      Stage::kSpecimen,
      "Stiffness or force that follows the measured pressure, which is not constant.",
      "Chou & Hannaford 1996, Tondu 2012: the force of a McKibben is proportional to its pressure. "
      "Richer & Hurmuzlu 2000: resistance and volume of the tube.",
      "A pressure step at fixed position. During ramps alone it is mistaken for viscosity, because the "
      "regulator "
      "droops in proportion to the velocity.",
      {{"stiffness",
        "F = k' (p - p0) e",
        {},
        {kStiffnessPerPsi},
        [](auto, const Reference&) { return std::make_unique<Coupling>(false, true); }},
       {"force",
        "F = f' (p - p0)",
        {},
        {kForcePerPsi},
        [](auto, const Reference&) { return std::make_unique<Coupling>(true, false); }},
       {"both",
        "F = (f' + k' e) (p - p0)",
        {},
        {kForcePerPsi, kStiffnessPerPsi},
        [](auto, const Reference&) { return std::make_unique<Coupling>(true, true); }},
       {"tube",
        "F = f' q, tau dq/dt = (p - p0) - q",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 0.01,
          .upper = 10.0,
          .starts = {0.1, 1.0},
          .logarithmic = true,
          .traits = {.lower_limit_law = "force"},
          .sheet =
              {.what = "Time in which the pressure inside the specimen has made 63 % of a step of the measured one.",
               .unit = "s",
               .range = "Physics: volume times flow resistance of the tube between sensor and specimen, from a short "
                        "wide tube to a needle valve; below 10 ms the pressures are the same on every regulator.",
               .errors = "The regulator's droop lasts as long as the ramp, so a slow tube resembles a relaxation. "
                         "Mistaken for a lag of the force channel."}}},
        {kForcePerPsi},
        [](std::span<const double> p, const Reference&) { return std::make_unique<BehindTube>(p[0]); }}},
      {.pressure = PressureNeed::kMeasured,
       .driven_by_pressure = true,
       .acts_on = "pressure path",
       .depends_on = {"pressure"},
       .shape_of = ShapeOf::kPressure,
       .words = "a force that follows the pressure"}};
  return physics;
}

}  // namespace isorig::model::effect
