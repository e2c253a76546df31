#pragma once
#include <functional>
#include <iosfwd>
#include <string>
#include <utility>
#include <vector>

#include "messages/recording.hpp"

/// A test bench of its own: straightforward integration at 1 ms, no line shared with model/. What it
/// conceals, the diagnosis must find.
namespace isorig::test {

struct ConcealedSpecimen {
  // Specimen.
  double stiffness_N_mm = 2.5;
  double arm_N_mm = 2.0;
  double arm_s = 0.8;
  double elongation_at_zero_mm = 20.0;
  // Concealed; zero or empty: not there.
  double friction_N = 0.0, presliding_mm = 0.03;
  double wen_exponent = 1.0, wen_sigma = 1.0;  ///< of the bristle (Bouc-Wen); both 1: Dahl's
  double quadratic_N_mm2 = 0.0;
  double second_arm_N_mm = 0.0, second_arm_s = 8.0;
  double power = 1.0;  ///< of the arm's dashpot: dz/dt = v - sign(z) |z|^power / arm_s
  double coupling_N_mm_psi = 0.0;
  double softening_N_mm = 0.0, softening_travel_mm = 15.0;
  double lag_s = 0.0;
  double delay_s = 0.0;
  double mass_kg = 0.0;
  double drift_N_h = 0.0;
  double slip_mm = 0.0, slip_s = 0.0;
  double slip_creep_s = 0.0;                                  ///< half life of what is still to slip; 0: all at once
  std::vector<std::pair<double, double>> further_slips = {};  ///< time (s), slip (mm)
  double gap_mm = 0.0;
  bool slack = false;
  double fung_1_mm = 0.0;                                    ///< the arm is driven by exp(b x) dx instead of dx
  double relaxation_1_mm = 0.0;                              ///< its time constant is that times exp(b x)
  double shortening_ratio = 1.0;                             ///< and that times this while its dashpot shortens
  double lengthening_N_s_mm = 0.0, shortening_N_s_mm = 0.0;  ///< dashpots in parallel
  double mullins_N_mm = 0.0, mullins_mm = 12.0;              ///< Ogden and Roxburgh: k / r and sqrt(2 m / k)
  double set_N_mm = 0.0;                                     ///< force lost per mm of the largest position
  double load_share = 0.0;                ///< of the specimen's force, on the bristle of `presliding_mm`
  double lock_N_mm = 0.0, lock_mm = 6.0;  ///< k x^2 / (L - x)
  double rubber_N_mm = 0.0, rubber_mm = 12.0, rubber_exponent = 6.0;  ///< Ogden, its slope at rest taken off
  double snap_N_mm = 0.0, snap_mm = 0.6;                              ///< a shallow truss of that height
  double gas_N_psi = 0.0, gas_s = 0.8, braid_angle_deg = 25.0, gas_exponent = 1.2;  ///< trapped in a braid
  // In no catalogue.
  double ripple_N = 0.0, ripple_mm = 0.4;
  double drag_N_s_mm2 = 0.0;    ///< of a dashpot, for each mm of the position
  double drag_N_s2_mm2 = 0.0;   ///< times the square of the velocity, against the motion
  double friction_N_mm2 = 0.0;  ///< of the bristle, for each mm of the position squared
  double arm_N_mm3 = 0.0;       ///< of the arm, for each mm of the position squared
  double arm_N_s_mm2 = 0.0;     ///< of the arm, for each mm/s of the speed
  // Instruments.
  double force_noise_N = 0.02;
  double coloured_N = 0.0, coloured_s = 2.0;
  double position_noise_mm = 4e-4;
  double force_step_N = 0.001;
  double fast_interval_s = 0.005;  ///< of readings round the ramps
  int spikes = 0;
  double pressure_wander_psi = 0.02;
  unsigned seed = 1;
};

/// What is not as it is by default: "friction_N=0.8,seed=3".
void PrintTo(const ConcealedSpecimen& specimen, std::ostream* out);

/// One shortened session: triangle, then +-2 mm at five velocities with holds and slow returns; 200 Hz round
/// the ramps, 5 Hz else, stamps jittered. `slow` scales how long it takes.
[[nodiscard]] messages::Recording record(const ConcealedSpecimen& bench);
/// Other velocities and a sine, noise-free force for measuring predictions.
[[nodiscard]] messages::Recording record_other(const ConcealedSpecimen& bench);

/// With the readings of the resting crosshead no closer than `interval_s`, and all others.
[[nodiscard]] messages::Recording seldom_read_at_rest(const messages::Recording& recording, double interval_s);

}  // namespace isorig::test
