#pragma once
#include <optional>
#include <vector>

#include "proof/generator/motion.hpp"

/// The rig of the concealed-effect study. Written apart from model/ and sim/ on purpose, and stepped by other
/// rules (trapezoidal and midpoint steps of half a millisecond): whoever diagnoses with the catalogue must
/// not be judged by the catalogue's own arithmetic. Extension and tension are positive.
namespace isorig::proof {

/// Spring and dashpot in series. exponent 1 and yield 0: linear. Else the dashpot moves at
/// (|F| - yield)^(1/exponent), scaled so that at 1 N it is the linear one.
struct Arm {
  double stiffness_N_mm = 0.0;
  double time_constant_s = 1.0;
  double exponent = 1.0;
  double yield_N = 0.0;
};

struct Specimen {
  double rest_length_mm = 90.0;
  double pressurized_rest_length_mm = 75.0;
  double stiffness_N_mm = 2.0;
  std::vector<Arm> arms;
};

/// Follows its reference as a damped second-order system with limited acceleration: lag and overshoot.
struct Crosshead {
  double bandwidth_1_s = 70.0;
  double damping = 0.8;
  double acceleration_mm_s2 = 800.0;
};

/// A regulator that lets the pressure give way to motion, and wanders slowly.
struct Air {
  double nominal_psi = 15.0;
  double droop_psi_mm = 0.03;
  double recovery_s = 1.5;
  double swing_psi = 0.02;
  double swing_period_s = 1100.0;
};

/// What the nominal model knows nothing of. Zero (or empty) is absence.
struct Hidden {
  // coulomb_friction: four sliders that yield one after the other (Iwan), with Stribeck weakening
  double friction_N = 0.0;
  double presliding_mm = 0.02;
  double stribeck_share = 0.0;  ///< of the friction, lost at speed
  double stribeck_mm_s = 1.0;
  // strain_stiffening
  double quadratic_N_mm2 = 0.0;
  double cubic_N_mm3 = 0.0;
  double exponential_N = 0.0;
  double exponential_mm = 2.0;
  double knee_N_mm = 0.0;
  double knee_at_mm = 0.5;
  double knee_width_mm = 0.3;
  // second_relaxation
  std::vector<Arm> further_arms;
  // pressure_coupling
  double force_per_pressure_N_psi = 0.0;
  double stiffness_per_pressure_N_mm_psi = 0.0;
  // cyclic_softening
  double softening = 0.0;  ///< share of the elastic stiffness
  double softening_travel_mm = 30.0;
  // force_lag, force_delay, fixture_inertia
  double lag_s = 0.0;
  double delay_s = 0.0;
  double mass_kg = 0.0;
  // zero_drift
  double drift_N = 0.0;       ///< at the end of four thousand seconds, or the size of the exponential
  double drift_time_s = 0.0;  ///< 0: linear
  // grip_slip
  double slip_mm = 0.0;
  double slip_at_s = 0.0;
  // crosshead_backlash (full width)
  double backlash_mm = 0.0;
  // slack
  bool slack = false;
  // Not in any catalogue:
  double ripple_N = 0.0;  ///< force that repeats with the screw
  double ripple_pitch_mm = 1.0;
  double thermal_share = 0.0;  ///< of the elastic force, with the room's heating
  double thermal_period_s = 900.0;
  double snap_N = 0.0;  ///< a strand that buckles at one position and snaps back at another
  double snap_at_mm = 0.6;
  double snap_width_mm = 0.4;
  double thixotropy = 0.0;  ///< share of the arms' force lost with stirring, won back at rest
  double thixotropy_s = 20.0;
  double resonance_Hz = 0.0;  ///< the load train rings
  double resonance_damping = 0.05;
  double range_gain = 0.0;  ///< the amplifier's second range has another gain
  double range_from_N = 0.0;
};

struct RigParameters {
  Specimen specimen;
  Crosshead crosshead;
  Air air;
  Hidden hidden;
};

/// When the recorders look.
struct Sampling {
  double dense_s = 0.005;
  double sparse_s = 0.2;
  double pressure_s = 0.2;
  double pressure_from_s = 0.003;
};

/// What perfect instruments would have read.
struct Trace {
  std::vector<double> t_s;
  std::vector<double> position_mm;  ///< of the crosshead
  std::vector<double> force_N;
  std::vector<double> pressure_t_s;
  std::vector<double> pressure_psi;
};

inline constexpr double kStep_s = 0.5e-3;

/// `jitter_s(i)` moves the i-th frame sample; pass an empty vector for none.
[[nodiscard]] Trace simulate(const RigParameters& rig, const Motion& motion, const Sampling& sampling,
                             const std::vector<double>& jitter_s = {}, double step_s = kStep_s);

/// The times at which the frame is read, without jitter.
[[nodiscard]] std::vector<double> frame_times(const Motion& motion, const Sampling& sampling);

}  // namespace isorig::proof
