#include "sim/pressure/pneumatics.hpp"

#include <algorithm>

namespace isorig::sim {

Pneumatics::Pneumatics(const PneumaticParameters& p, double actuator_mL, double dt_s) noexcept
    : p_(p),
      orifice_(p.critical_ratio),
      dt_s_(dt_s),
      manifold_L_(1e-3 * p.manifold_volume_mL),
      inverse_supply_L_(1e3 / p.supply_volume_mL),
      regulator_bar_(p.ambient_bar + kBarPerPsi * std::min(p.supply_psi, p.tank_psi)),
      fill_(1e-3 * p.valve_time_ms, dt_s, 0.0),
      vent_(1e-3 * p.valve_time_ms, dt_s, 1.0),
      dump_(1e-3 * p.dump_time_ms, dt_s, 1.0),
      volume_L_(manifold_L_ + 1e-3 * actuator_mL),
      chamber_bar_L_(p.ambient_bar * volume_L_),
      supply_bar_L_(regulator_bar_ * 1e-3 * p.supply_volume_mL) {}

Pneumatics::Flows Pneumatics::flows(double chamber_bar, double supply_bar) const noexcept {
  Flows f;
  const double regulator_bar = supply_psi_now > 0.0 ? p_.ambient_bar + kBarPerPsi * supply_psi_now : regulator_bar_;
  if (!supply_empty) f.regulator = p_.regulator_L_s_bar * std::max(0.0, regulator_bar - supply_bar);
  if (fill_mean_ > 0.0) {
    f.fill = orifice_.flow_L_s(fill_mean_ * p_.fill_conductance_L_s_bar, supply_bar, chamber_bar);
  }
  const double outlet = vent_mean_ * p_.vent_conductance_L_s_bar + dump_mean_ * p_.dump_conductance_L_s_bar;
  if (outlet > 0.0) f.out = orifice_.flow_L_s(outlet, chamber_bar, p_.ambient_bar);
  f.out += 1e-3 * p_.leak_mL_s_bar * leak_factor * (chamber_bar - p_.ambient_bar);
  if (burst_mL_s_bar > 0.0) f.out += 1e-3 * burst_mL_s_bar * (chamber_bar - p_.ambient_bar);
  return f;
}

void Pneumatics::step(const ValveTargets& targets, double actuator_mL) noexcept {
  fill_mean_ = fill_.step(fill_stuck_open ? 1.0 : fill_stuck_shut ? 0.0 : targets.fill);
  vent_mean_ = vent_.step(vent_stuck_open ? 1.0 : vent_stuck_shut ? 0.0 : targets.vent);
  dump_mean_ = dump_.step(dump_stuck_shut ? 0.0 : targets.dump);
  const double volume_end_L = manifold_L_ + 1e-3 * actuator_mL;

  const Flows a = flows(chamber_bar_L_ / volume_L_, supply_bar_L_ * inverse_supply_L_);
  const double inverse_end = 1.0 / volume_end_L;
  const Flows b = flows((chamber_bar_L_ + dt_s_ * (a.fill - a.out)) * inverse_end,
                        (supply_bar_L_ + dt_s_ * (a.regulator - a.fill)) * inverse_supply_L_);
  const double h = 0.5 * dt_s_;
  const double taken = h * (a.regulator + b.regulator);
  const double filled = h * (a.fill + b.fill);
  const double out = h * (a.out + b.out);
  supply_bar_L_ += taken - filled;
  chamber_bar_L_ += filled - out;
  taken_L_ += taken;
  released_L_ += out;
  volume_L_ = volume_end_L;
  pressure_psi_ = (chamber_bar_L_ * inverse_end - p_.ambient_bar) * (1.0 / kBarPerPsi);
}

}  // namespace isorig::sim
