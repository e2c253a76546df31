#include "sim/physics.hpp"

namespace isorig::sim {
namespace {

class ActuatorProcess final : public model::Process {
 public:
  ActuatorProcess(model::Actuator& actuator, const double& pressure_psi) noexcept
      : actuator_(actuator), pressure_psi_(pressure_psi) {}
  void reset(const model::Instant& first) noexcept override { actuator_.settle(first.position_mm, pressure_psi_); }
  void force(const model::Instant& now, double* columns) noexcept override {
    columns[0] = now.dt_s > 0.0 ? actuator_.step(now.position_mm, pressure_psi_, now.dt_s) : actuator_.force_N();
  }

 private:
  model::Actuator& actuator_;
  const double& pressure_psi_;
};

}  // namespace

SpecimenPhysics::SpecimenPhysics(const model::ActuatorParameters& actuator, const std::optional<PhysicsConfig>& physics)
    : actuator_(actuator) {
  if (!physics) return;
  model::Reference reference;
  reference.elongation_at_zero_mm =
      actuator_.initial_length_mm() - actuator_.rest_length_mm(physics->nominal_pressure_psi);
  pressure_from_psi_ = physics->spec.pressure_from_psi.value_or(physics->nominal_pressure_psi);
  reference.nominal_pressure_psi = pressure_from_psi_;

  model::ModelSpec spec = physics->spec;
  if (!physics->replaces_actuator) {
    actuator_part_.name = "actuator";
    actuator_part_.stage = model::Stage::kSpecimen;
    model::Law law;
    law.name = "actuator";
    law.coefficients = {{.name = "scale", .sign = model::Sign::kNonNegative}};
    law.make = [this](std::span<const double>, const model::Reference&) -> std::unique_ptr<model::Process> {
      return std::make_unique<ActuatorProcess>(actuator_, pressure_psi_);
    };
    actuator_part_.laws.push_back(std::move(law));
    spec.parts.insert(spec.parts.begin(), {&actuator_part_, &actuator_part_.laws.front(), {}, {1.0}, true});
  }
  running_ = std::make_unique<model::RunningModel>(spec, reference);
  now_.excess_pressure_psi = -pressure_from_psi_;
  running_->reset(now_);
  force_N_ = running_->step(now_);
}

double SpecimenPhysics::step_composed(double position_mm, double velocity_mm_s, double pressure_psi,
                                      double dt_s) noexcept {
  pressure_psi_ = pressure_psi;
  now_.t_s += dt_s;
  now_.dt_s = dt_s;
  now_.step_mm = position_mm - now_.position_mm;
  now_.position_mm = position_mm;
  // The rest length follows the pressure, so that a model without one is stretched by filling, as the
  // actuator is.
  now_.elongation_mm = position_mm + actuator_.initial_length_mm() - actuator_.rest_length_mm(pressure_psi);
  now_.acceleration_mm_s2 = (velocity_mm_s - now_.velocity_mm_s) / dt_s;
  now_.velocity_mm_s = velocity_mm_s;
  now_.excess_pressure_psi = pressure_psi - pressure_from_psi_;
  return running_->step(now_);
}

}  // namespace isorig::sim
