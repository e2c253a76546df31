#pragma once
#include <cmath>

#include "sim/config.hpp"

namespace isorig::sim {

inline constexpr double kBarPerPsi = 0.0689475729;

/// Flow through an orifice, ISO 6358-1, in L/s of ANR air (100 kPa, 20 C): q = C p_up * choke(p_down / p_up),
/// choke = 1 up to the critical ratio b and sqrt(1 - ((r - b)/(1 - b))^2) beyond. Signed: positive from `a`
/// to `b_side`. Within 0.5 % of equal pressures it is linear (laminar), where the square root's slope is
/// infinite.
struct Orifice {
  double critical_ratio = 0.4;
  double inverse_span = 1.0 / 0.6;
  double laminar_slope = 0.0;
  static constexpr double kLaminarRatio = 0.995;

  Orifice() = default;
  explicit Orifice(double b) noexcept : critical_ratio(b), inverse_span(1.0 / (1.0 - b)) {
    const double u = (kLaminarRatio - b) * inverse_span;
    laminar_slope = std::sqrt(1.0 - u * u) / (1.0 - kLaminarRatio);
  }
  [[nodiscard]] double flow_L_s(double conductance, double up_bar, double down_bar) const noexcept {
    if (up_bar < down_bar) return -flow_L_s(conductance, down_bar, up_bar);
    const double r = down_bar / up_bar;
    if (r <= critical_ratio) return conductance * up_bar;
    if (r >= kLaminarRatio) return conductance * up_bar * laminar_slope * (1.0 - r);
    const double u = (r - critical_ratio) * inverse_span;
    return conductance * up_bar * std::sqrt(1.0 - u * u);
  }
};

/// A valve spool or the average of a fast PWM: first order in opening, exact within a step.
class Opening {
 public:
  explicit Opening(double time_s, double dt_s, double start) noexcept
      : decay_(std::exp(-dt_s / time_s)), mean_((1.0 - decay_) * time_s / dt_s), value_(start) {}
  /// Moves towards `target` for one step; returns the mean opening in it.
  double step(double target) noexcept {
    const double off = value_ - target;
    if (off == 0.0) return target;
    const double mean = target + off * mean_;
    value_ = std::abs(off) < 1e-9 ? target : target + off * decay_;
    return mean;
  }
  [[nodiscard]] double value() const noexcept { return value_; }

 private:
  double decay_, mean_, value_;
};

/// What the valves are told, as fractions of full opening.
struct ValveTargets {
  double fill = 0.0;
  double vent = 1.0;
  double dump = 1.0;  ///< normally open
};

/// Supply regulator, fill, vent and dump valve, and one chamber: manifold, tubing and actuator at one
/// pressure.
///
/// Law: isothermal ideal gas, p V = m R T, with the amount of air m R T kept in bar L (ANR litres at 1 bar),
/// so that air is conserved to rounding and a change of the actuator's volume acts on the pressure at once.
/// Isothermal, since at these volumes and a second per filling the walls win; the polytropic overshoot of a
/// fast filling (a few percent, relaxing within a second) is not modelled. Stepped by Heun's method with the
/// volume linear in the step and the openings at their mean: second order, error stated by tests/sim.
/// Pressures in bar are absolute, in psi gauge.
class Pneumatics {
 public:
  Pneumatics(const PneumaticParameters& parameters, double actuator_mL, double dt_s) noexcept;

  /// One step; the actuator's volume goes to `actuator_mL`.
  void step(const ValveTargets& targets, double actuator_mL) noexcept;

  [[nodiscard]] double pressure_psi() const noexcept { return pressure_psi_; }
  [[nodiscard]] double supply_psi() const noexcept {
    return (supply_bar_L_ * inverse_supply_L_ - p_.ambient_bar) / kBarPerPsi;
  }
  /// Air in the chamber and behind the regulator, in ANR litres.
  [[nodiscard]] double chamber_L() const noexcept { return chamber_bar_L_; }
  [[nodiscard]] double supply_L() const noexcept { return supply_bar_L_; }
  /// Air that came through the regulator, and that left to the ambient, since the start.
  [[nodiscard]] double taken_L() const noexcept { return taken_L_; }
  [[nodiscard]] double released_L() const noexcept { return released_L_; }

  // Faults, to be set at any time.
  bool supply_empty = false;
  double leak_factor = 1.0;
  bool fill_stuck_open = false, fill_stuck_shut = false;
  bool vent_stuck_open = false, vent_stuck_shut = false, dump_stuck_shut = false;
  double burst_mL_s_bar = 0.0;  ///< a hose that has burst: on top of the leak
  double supply_psi_now = 0.0;  ///< the regulator's set pressure, when above 0: somebody turned its knob

 private:
  struct Flows {
    double regulator = 0.0, fill = 0.0, out = 0.0;
  };
  [[nodiscard]] Flows flows(double chamber_bar, double supply_bar) const noexcept;

  PneumaticParameters p_;
  Orifice orifice_;
  double dt_s_;
  double manifold_L_;
  double inverse_supply_L_;
  double regulator_bar_;
  Opening fill_, vent_, dump_;
  double fill_mean_ = 0.0, vent_mean_ = 0.0, dump_mean_ = 0.0;
  double volume_L_;
  double chamber_bar_L_, supply_bar_L_;
  double taken_L_ = 0.0, released_L_ = 0.0;
  double pressure_psi_ = 0.0;
};

}  // namespace isorig::sim
