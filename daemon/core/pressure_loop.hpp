#pragma once
#include <cstdint>
#include <limits>

#include "drivers/api/pressure.hpp"
#include "protocol/limits.hpp"

namespace isorig::base {
class TomlTable;
}

/// The pressure loop: ELVH reading against the step's set-point, through a fill and a vent valve.
///
/// The chamber is an integrator. With absolute pressures, ISO 6358 gives for the rate at duty u in [0, 1]
///
///   dP/dt = +u_fill * fill_gain_per_s * Ps * phi(P / Ps)        (supply Ps -> chamber P)
///   dP/dt = -u_vent * vent_gain_per_s * P  * phi(Pa / P)        (chamber P -> atmosphere Pa)
///   phi(r) = 1                                   r <= b         (choked)
///          = sqrt(1 - ((r - b) / (1 - b))^2)     b < r < 1
///
/// so the loop computes the rate it wants and divides by the rate the valve can give there:
///
///   rate = d(reference)/dt + kp (e + (1/Ti) integral e) + feedforward_psi_per_mm * crosshead velocity
///
/// At its target the loop has a dead zone: while |e|, smoothed over 30 ms, is below `dead_zone_psi` (and until it is
/// twice as large), e counts as 0 and the integral dies out within `kIntegralFades_s`. A reading that has died near the
/// set-point (a sensor's tube blocked, a count stuck) would otherwise be filled after, more and more, for an error that
/// never changes: 0.002 psi wound the shipped loop up to 31 psi from 23. Now such an error moves no valve, and a larger
/// one winds up so fast that PressureGuard finds it (pressure_faults_test). The price is a ripple of
/// some thousandths of a psi; 0.01 psi were seen in the force of a stiff specimen.
///
/// The reference runs to the target at the rate limit. Anti-windup: the integral stands still while the valve is
/// saturated in the direction of the error, and it never asks for more than a quarter of the full fill rate: it is
/// there for the leak and for gains that are not quite right. The gains are in 1/s of the linearised loop; with a dead
/// time Td (valve, wire, sample) the phase margin at crossover kp is 90 deg - kp * Td * 57.3 - atan(1 / (kp * Ti)).
namespace isorig::daemon {

struct PressureLoopConfig {
  enum class Actuator : std::uint8_t { kValves, kRegulator } actuator = Actuator::kValves;
  double supply_psi = 45.0;                                            ///< gauge
  double regulator_max_psi = std::numeric_limits<double>::infinity();  ///< it refuses a larger set-point, trim included
  double fill_gain_per_s = 0.4;  ///< full-duty rate over absolute upstream pressure, nominal volume
  double vent_gain_per_s = 0.4;
  double proportional_per_s = 25.0;
  double integral_time_s = 0.25;
  double rate_limit_psi_s = protocol::Limits::kLoopRate_psi_s;  ///< of the reference
  double feedforward_psi_per_mm = 0.0;  ///< pressure the chamber would lose per mm of extension with both valves shut
  double minimum_duty = 0.0;            ///< below it a valve does not open; smaller commands are shut
  double settled_tolerance_psi = 0.1;
  double dead_zone_psi = 0.004;        ///< at the target, an error below it counts as zero
  double unreachable_error_psi = 0.5;  ///< error and saturation for longer than `unreachable_after_s` ...
  double unreachable_after_s = 5.0;    ///< ... is a set-point that cannot be reached (leak, empty supply)
  // How far a sound rig may deviate from these numbers (PressureGuard).
  double response_min = 0.33;          ///< of the configured gains, at least; and at most its inverse
  double leak_max_psi_s = 0.0;         ///< faster is a fault; 0: a twentieth of what the full fill valve gives
  double motion_max_psi_per_mm = 0.0;  ///< pressure by motion; 0: thrice the feed-forward, at least a quarter
  double allowance_psi = 0.2;          ///< of noise and rounding, in what is summed up

  static constexpr double kDeadDuty = 0.05;   ///< the first part of a duty need not open the valve
  static constexpr double kLeakShare = 0.05;  ///< of the full fill rate at the supply's pressure
  static constexpr double kIntegralShare =
      0.25;  ///< of the full fill rate, either way: the integral is for leak and gain
  static constexpr double kIntegralFades_s = 0.5;  ///< in the dead zone
  static constexpr double kErrorSmoothing_s = 0.03;
  static constexpr double kDeadZoneLeft = 2.0;  ///< times its width: noise about the edge must not wind the integral up
  static constexpr double kFillings = 3.0;      ///< from 0 to the greatest pressure, without venting in between

  [[nodiscard]] double leak_bound_psi_s() const noexcept;
  [[nodiscard]] double motion_bound_psi_mm() const noexcept;
  [[nodiscard]] double hold_allowance_psi() const noexcept { return 3.0 * allowance_psi; }
  /// Duty that may flow for ever: the leak, and what does not open the valve.
  [[nodiscard]] double fill_allowance() const noexcept;
  /// Full-duty seconds above the allowance that are no filling any more.
  [[nodiscard]] double fill_time_bound_s(double pressure_max_psi) const noexcept;

  /// Reads [pressure_loop].
  static PressureLoopConfig read(const base::TomlTable& table);
};

/// Pure: no clock, no I/O, no allocation. Call update() once per pressure sample (100 Hz or more).
class PressureLoop {
 public:
  explicit PressureLoop(const PressureLoopConfig& config) noexcept;

  /// A new set-point; `rate_psi_s` <= 0 takes the configured limit.
  void set_target(double target_psi, double rate_psi_s, std::int64_t mono_ns) noexcept;
  /// Vent: the vent valve fully open, the loop off, until the next set_target().
  void vent() noexcept;
  /// Both valves shut, the loop off (the pressure holds as well as the chamber does).
  void shut() noexcept;

  /// One step of the loop. `crosshead_velocity_mm_s` is what the frame was told to do, for the feed-forward.
  pressure::Command update(std::int64_t mono_ns, double pressure_psi, double crosshead_velocity_mm_s) noexcept;

  [[nodiscard]] double target_psi() const noexcept { return target_psi_; }
  [[nodiscard]] double reference_psi() const noexcept { return reference_psi_; }
  /// How long the reading has been within the tolerance of the target, without a break.
  [[nodiscard]] double settled_for_s(std::int64_t mono_ns) const noexcept;
  /// In control, and the reading within the tolerance of the target.
  [[nodiscard]] bool is_holding() const noexcept { return mode_ == Mode::kControl && settled_since_ns_ >= 0; }
  /// Both valves are kept shut: nothing is regulated.
  [[nodiscard]] bool is_shut() const noexcept { return mode_ == Mode::kShut; }
  /// The set-point cannot be reached (see the configuration).
  [[nodiscard]] bool unreachable() const noexcept { return unreachable_; }
  [[nodiscard]] const pressure::Command& command() const noexcept { return command_; }

 private:
  enum class Mode : std::uint8_t { kShut, kControl, kVent };

  PressureLoopConfig config_;
  double integral_most_psi_s_;  ///< either way: kIntegralShare
  Mode mode_ = Mode::kShut;
  double target_psi_ = 0.0;
  double rate_psi_s_ = 0.0;
  double reference_psi_ = 0.0;
  double integral_psi_s_ = 0.0;
  double smooth_error_psi_ = 0.0;
  bool in_dead_zone_ = false;
  bool reference_started_ = false;
  bool unreachable_ = false;
  std::int64_t last_ns_ = 0;
  std::int64_t settled_since_ns_ = -1;
  std::int64_t saturated_since_ns_ = -1;
  pressure::Command command_;
};

}  // namespace isorig::daemon
