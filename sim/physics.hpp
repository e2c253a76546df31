#pragma once
#include <memory>
#include <optional>

#include "model/actuator.hpp"
#include "model/composed.hpp"
#include "sim/config.hpp"

namespace isorig::sim {

/// The force of the specimen: its actuator, its actuator with effects of the catalogue, or a composed model
/// in its place. The composition is the one that identification uses (model/composed.hpp), with the actuator
/// as one more part, so that kinematic effects act before it and lags of the load cell after everything.
class SpecimenPhysics {
 public:
  SpecimenPhysics(const model::ActuatorParameters& actuator, const std::optional<PhysicsConfig>& physics);
  SpecimenPhysics(const SpecimenPhysics&) = delete;
  SpecimenPhysics& operator=(const SpecimenPhysics&) = delete;

  /// Moves there within `dt_s`; returns the force at the end [N]. No allocation.
  double step(double position_mm, double velocity_mm_s, double pressure_psi, double dt_s) noexcept {
    if (running_ == nullptr) [[likely]] {
      return actuator_.step(position_mm, pressure_psi, dt_s);
    }
    return step_composed(position_mm, velocity_mm_s, pressure_psi, dt_s);
  }
  [[nodiscard]] double force_N() const noexcept { return force_N_; }  ///< at the start: 0 mm, 0 psi
  [[nodiscard]] const model::Actuator& actuator() const noexcept { return actuator_; }

 private:
  double step_composed(double position_mm, double velocity_mm_s, double pressure_psi, double dt_s) noexcept;

  model::Actuator actuator_;
  model::Physics actuator_part_;  // referred to by the running model
  std::unique_ptr<model::RunningModel> running_;
  model::Instant now_;
  double pressure_psi_ = 0.0;
  double pressure_from_psi_ = 0.0;  ///< what the model counts from
  double force_N_ = 0.0;
};

}  // namespace isorig::sim
