#include "model/actuator.hpp"

#include <algorithm>
#include <stdexcept>

namespace isorig::model {
namespace {
constexpr std::size_t kAtOnce = 512;  // steps whose pressures are compared before: they are still in the nearest cache
constexpr double kLawEnd = 1.25;      // of the pressure at which ML was measured; above it L0 stays (actuator.hpp)
}  // namespace

Actuator::Actuator(const ActuatorParameters& p)
    : initial_length_mm_(p.initial_length_mm),
      contraction_mm_(p.initial_length_mm - p.minimum_length_mm),
      inverse_reference_1_psi_(1.0 / p.minimum_length_psi),
      law_end_psi_(kLawEnd * p.minimum_length_psi),
      exponent_(p.contraction_exponent),
      quadratic_(p.contraction_exponent == 2.0),
      braid_(p.initial_length_mm, p.mesh_diameter_mm, p.braid_angle_deg) {
  if (!(p.minimum_length_mm > 0.0) || !(contraction_mm_ >= 0.0)) {
    throw std::invalid_argument("an actuator needs 0 < minimum length <= initial length");
  }
  if (!(p.minimum_length_psi > 0.0) || !(p.contraction_exponent > 0.0) || !(p.mesh_diameter_mm > 0.0) ||
      !(p.braid_angle_deg > 0.0 && p.braid_angle_deg < 90.0)) {
    throw std::invalid_argument("an actuator's pressure, exponent, diameter and braid angle must be positive");
  }
  std::vector<std::vector<double>> channels{p.mckibben.stiffness, p.mckibben.kappa, p.mckibben.gamma_1_s};
  const bool sheath = !p.sheath.stiffness.empty();
  if (sheath) channels.insert(channels.end(), {p.sheath.stiffness, p.sheath.kappa, p.sheath.gamma_1_s});
  table_ = PressureTable(p.pressure_psi, channels);
  stack_.add({});
  if (sheath) stack_.add({});
  settle(0.0, 0.0);
}

// The paper's ratios (after eq. 2): kappa = k2 / k1, gamma = k2 / eta for each element, and beta_s = k1s / k1 for the
// sheath. The table's channels are k1, kappa, gamma of the McKibben, then beta_s, kappa_s, gamma_s.
SlseParameters Actuator::parameters(std::size_t element, double pressure_psi) const noexcept {
  PressureTable::Values v;
  table_.evaluate(pressure_psi, v);
  if (element == 0) return SlseParameters::from_ratios(v[0] * stiffening(pressure_psi), v[1], v[2]);
  return SlseParameters::from_ratios(v[0] * v[3], v[4], v[5]);
}

void Actuator::set_parameters(double pressure_psi) noexcept {
  PressureTable::Values v;
  table_.evaluate(pressure_psi, v);
  stack_[0].parameters = SlseParameters::from_ratios(v[0] * stiffening(pressure_psi), v[1], v[2]);
  if (stack_.size() > 1) stack_[1].parameters = SlseParameters::from_ratios(v[0] * v[3], v[4], v[5]);
}

void Actuator::prepare(double pressure_psi, double dt_s) noexcept {
  set_parameters(pressure_psi);
  rest_mm_ = rest_length_mm(pressure_psi);
  for (std::size_t i = 0; i < stack_.size(); ++i) relaxations_[i] = relaxation(stack_[i].parameters.gamma_1_s * dt_s);
  prepared_psi_ = pressure_psi;
  prepared_dt_s_ = dt_s;
}

void Actuator::step_held(std::span<const double> position_mm, double* force_N) noexcept {
  // Copies: a force that is written could otherwise be any of these, and all would be read again at every step.
  const double free_mm = initial_length_mm_, rest_mm = rest_mm_;
  const auto relaxations = relaxations_;
  Slse mckibben = stack_[0], sheath = stack_[1];
  if (has_sheath()) {
    for (const double position : position_mm) {
      const double strain = (free_mm + position - rest_mm) / rest_mm;
      const double mckibben_N = mckibben.step(strain, relaxations[0]);
      *force_N++ = mckibben_N + sheath.step(strain, relaxations[1]);
    }
    stack_[1] = sheath;
  } else {
    for (const double position : position_mm)
      *force_N++ = mckibben.step((free_mm + position - rest_mm) / rest_mm, relaxations[0]);
  }
  stack_[0] = mckibben;
  force_N_ = force_N[-1];
}

void Actuator::step_all(std::span<const double> position_mm, std::span<const double> pressure_psi, double dt_s,
                        std::span<double> force_N) noexcept {
  for (std::size_t begin = 0, end = 0; begin < position_mm.size(); begin = end) {
    const double pressure = pressure_psi[begin];
    const std::size_t last = std::min(position_mm.size(), begin + kAtOnce);
    for (end = begin + 1; end < last && pressure_psi[end] == pressure;) ++end;
    if (pressure != prepared_psi_ || dt_s != prepared_dt_s_) prepare(pressure, dt_s);
    step_held(position_mm.subspan(begin, end - begin), force_N.data() + begin);
  }
}

double Actuator::settle(double position_mm, double pressure_psi) noexcept {
  set_parameters(pressure_psi);
  prepared_psi_ = std::numeric_limits<double>::quiet_NaN();
  stack_.settle(strain(position_mm, pressure_psi));
  return force_N_ = stack_.force_N();
}

}  // namespace isorig::model
