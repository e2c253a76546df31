#pragma once
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "model/braid.hpp"
#include "model/pressure_table.hpp"
#include "model/slse.hpp"

namespace isorig::model {

/// Identified (or chosen) at a few pressures; interpolated in between (PressureTable).
struct SlseByPressure {
  std::vector<double> stiffness;  ///< k1 [N] of the McKibben; beta_s = k1s / k1 [1] of a sheath
  std::vector<double> kappa;      ///< k2 / k1 [1]
  std::vector<double> gamma_1_s;  ///< k2 / eta [1/s]
};

struct ActuatorParameters {
  double initial_length_mm = 0.0;      ///< IL: length at 0 psi, the zero of `position_mm`
  double minimum_length_mm = 0.0;      ///< ML: free length at `minimum_length_psi`
  double minimum_length_psi = 20.0;    ///< 20 in the paper
  double contraction_exponent = 1.85;  ///< free contraction ~ p^this
  double mesh_diameter_mm = 0.0;       ///< at IL
  double braid_angle_deg = 0.0;        ///< thread to axis, at IL
  std::vector<double> pressure_psi;    ///< where the following are given, increasing
  SlseByPressure mckibben;
  SlseByPressure sheath;  ///< empty: no sheath
};

/// A McKibben actuator with or without a viscoelastic sheath: one or two standard linear solids in parallel
/// round a rest length that shortens with pressure (Bennington, Wang et al., eqs. 1-7).
///
///   L0(p) = IL - (IL - ML) (p / 20 psi)^n,   e = (IL + x - L0(p)) / L0(p),   F = sum of the elements' forces
///
/// Position x and strain e: extension positive; F: tension positive [N]; p: gauge [psi], negative counts as
/// 0. Both the paper's strain and its speeds are relative to the pressurized rest length L0(p). Between IL
/// and ML the paper gives no curve: n = 1.85 is chosen because it leaves 1.3 to 1.9 mm of contraction at
/// 5 psi, where the paper has to limit its shortening to 1 mm. Beyond 1.25 times the pressure of ML (25 psi) that
/// power would shorten the actuator to nothing, so L0 stays there and the McKibben's k1 grows with p: at a fixed
/// length a braid pulls in proportion to the pressure (Chou and Hannaford 1996, eq. 5). The elements are linear in
/// strain, as in the paper, so the actuator pushes when it is shorter than L0 (a real one buckles), and the response is
/// symmetrical (the measured one is stiffer in extension): effects for that are model/effects/, which the
/// simulated rig composes with this actuator (sim/physics.hpp).
class Actuator {
 public:
  /// Throws std::invalid_argument on lengths or tables that make no actuator.
  explicit Actuator(const ActuatorParameters& parameters);

  /// Steady state at a position and pressure. Returns the force [N].
  double settle(double position_mm, double pressure_psi) noexcept;
  /// Moves there, strain linear in time, within `dt_s` > 0; the parameters are those at the end of the step.
  /// Returns the force at the end [N]. No allocation.
  double step(double position_mm, double pressure_psi, double dt_s) noexcept {
    if (pressure_psi != prepared_psi_ || dt_s != prepared_dt_s_) prepare(pressure_psi, dt_s);
    const double strain = (initial_length_mm_ + position_mm - rest_mm_) / rest_mm_;
    force_N_ = stack_[0].step(strain, relaxations_[0]);
    if (has_sheath()) force_N_ += stack_[1].step(strain, relaxations_[1]);
    return force_N_;
  }

  /// step() to each position and pressure in turn, the forces into `force_N`; all three as long. For a record that is
  /// there whole: where a pressure stays, the state does not leave the registers.
  void step_all(std::span<const double> position_mm, std::span<const double> pressure_psi, double dt_s,
                std::span<double> force_N) noexcept;

  [[nodiscard]] double rest_length_mm(double pressure_psi) const noexcept {
    if (!(pressure_psi > 0.0)) return initial_length_mm_;
    if (pressure_psi > law_end_psi_) pressure_psi = law_end_psi_;
    const double u = pressure_psi * inverse_reference_1_psi_;
    return initial_length_mm_ - contraction_mm_ * (quadratic_ ? u * u : std::pow(u, exponent_));
  }
  [[nodiscard]] double strain(double position_mm, double pressure_psi) const noexcept {
    const double rest_mm = rest_length_mm(pressure_psi);
    return (initial_length_mm_ + position_mm - rest_mm) / rest_mm;
  }
  [[nodiscard]] double volume_mm3(double position_mm) const noexcept {
    return braid_.volume_mm3(initial_length_mm_ + position_mm);
  }
  [[nodiscard]] const Braid& braid() const noexcept { return braid_; }
  [[nodiscard]] double initial_length_mm() const noexcept { return initial_length_mm_; }
  [[nodiscard]] bool has_sheath() const noexcept { return stack_.size() > 1; }
  [[nodiscard]] double force_N() const noexcept { return force_N_; }
  /// The elements' parameters at a pressure; index 0 the McKibben, 1 the sheath.
  [[nodiscard]] SlseParameters parameters(std::size_t element, double pressure_psi) const noexcept;

 private:
  void set_parameters(double pressure_psi) noexcept;
  /// step_all() at the pressure and step that are prepared.
  void step_held(std::span<const double> position_mm, double* force_N) noexcept;
  /// All that depends on pressure and step alone, for the next steps that have the same.
  void prepare(double pressure_psi, double dt_s) noexcept;
  /// Of k1, against the table's constant end.
  [[nodiscard]] double stiffening(double pressure_psi) const noexcept {
    return pressure_psi > law_end_psi_ ? pressure_psi / law_end_psi_ : 1.0;
  }

  double initial_length_mm_ = 0.0;
  double contraction_mm_ = 0.0;
  double inverse_reference_1_psi_ = 0.0;
  double law_end_psi_ = 0.0;
  double exponent_ = 2.0;
  bool quadratic_ = true;
  Braid braid_;
  PressureTable table_;
  SlseStack stack_;
  double prepared_psi_ = std::numeric_limits<double>::quiet_NaN();  // equal to nothing: prepare() has not run
  double prepared_dt_s_ = 0.0;
  double rest_mm_ = 0.0;
  std::array<Relaxation, SlseStack::kMaxElements> relaxations_{};
  double force_N_ = 0.0;
};

}  // namespace isorig::model
