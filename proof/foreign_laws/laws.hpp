#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "proof/foreign_laws/drive.hpp"

/// The physics of the second generator. Nothing here uses model/, and most formulas are written nowhere in it; the
/// exceptions are Ogden-Roxburgh, the set with a yield, the one-way dashpot, the braid near its end, two poles, the
/// bladder behind a tube, Bouc-Wen friction, the compliant play and the mass on a spring (docs/proof.md).
/// Forces in N (tension positive), lengths in mm, times in s, pressures in psi. Each law's valid range is that of its
/// arguments; each is tested against a closed form or a second writing in tests/proof/foreign_specimen_test.cpp and
/// foreign_rig_test.cpp.
namespace isorig::proof::foreign {

using Signal = std::vector<double>;

// --- friction.cpp: rate-independent unless said ----------------------------------------------------------------------

/// Dahl 1976 with exponent 2: dz/dx = sgn(1 - z sgn v) |1 - z sgn v|^2 / delta, F = force z. Dissipative.
[[nodiscard]] Signal dahl_square(const Drive& drive, double force_N, double presliding_mm);
/// Bouc 1967, Wen 1976: dz = (dx - (beta |dx| |z|^(n-1) z + gamma dx |z|^n)) / delta, beta + gamma = 1 so that |z|
/// <= 1. Passive for gamma in [-beta, beta] (Ikhouane & Rodellar 2007).
[[nodiscard]] Signal bouc_wen(const Drive& drive, double force_N, double presliding_mm, double exponent, double gamma);
/// LuGre (Canudas de Wit et al. 1995) with its bristle damping and the Stribeck exponent 1/2 (Bo & Pavelescu 1982):
/// dz/dt = v (1 - z sgn(v) / g(v)) / delta, g = 1 + excess exp(-sqrt(|v| / stribeck)).
[[nodiscard]] Signal lugre_half(const Drive& drive, double force_N, double presliding_mm, double excess,
                                double stribeck_mm_s);
/// Generalised Prandtl-Ishlinskii (Al Janaideh, Rakheja & Su 2009; Kuhnen 2003): stops whose thresholds differ on
/// loading and unloading by the share `asymmetry`, over a wide range of thresholds up to `reach_mm`.
[[nodiscard]] Signal prandtl_ishlinskii(const Drive& drive, double force_N, double reach_mm, double asymmetry);
/// F = force (2 / pi) atan(v / v0): smoothed Coulomb without memory (Mostaghel & Davis 1997).
[[nodiscard]] Signal arctan_friction(const Drive& drive, double force_N, double velocity_mm_s);
/// Coulomb friction in proportion to the load it carries (Amontons 1699; Duclusaud et al. 2025), mu |load|, behind a
/// bristle of Duhem's type dz/dx = (1 - z^3 sgn v) / delta (cubic; Coleman & Hodgdon 1986).
[[nodiscard]] Signal load_friction(const Drive& drive, double friction_coefficient, double presliding_mm);

// --- elasticity.cpp: forces beside a straight spring; F(0) = F'(0) = 0 unless said -----------------------------------

/// F = k x (exp(x^2 / L^2) - 1): quadratic exponent of Fung, Fronek & Patitucci 1979.
[[nodiscard]] double fung_square_N(double stiffness_N_mm, double position_mm, double length_mm);
/// Gent 1996 in uniaxial tension, minus its own slope at zero. stretch = 1 + x / length, must stay within `limit`
/// (J_m) of locking: J1 = stretch^2 + 2 / stretch - 3 < limit.
[[nodiscard]] double gent_N(double stiffness_N_mm, double position_mm, double length_mm, double limit);
/// Ogden 1972, a single term: F = 2 k L / (3 alpha) (s^(alpha-1) - s^(-alpha/2-1)), minus its slope at s = 1.
[[nodiscard]] double ogden_N(double stiffness_N_mm, double position_mm, double length_mm, double exponent);
/// Hyperbolic knee between two slopes: F = k ((u + sqrt(u^2 + w^2)) / 2), u = x - x0 (Bacon & Watts 1971).
[[nodiscard]] double hyperbolic_knee_N(double stiffness_N_mm, double position_mm, double at_mm, double width_mm);
/// Braid that locks: F = k x^2 / (lock - x) (rational; after the minimum braid angle of Davis & Caldwell 2006).
[[nodiscard]] double braid_lock_N(double stiffness_N_mm, double position_mm, double lock_mm);

// --- relaxation.cpp: sums of many arms whose weights come from an analytic spectrum ---------------------------------

struct SpectralArm {
  double weight = 0.0;
  double time_s = 1.0;
};
/// Springpot: G(t) = (t / 1 s)^-alpha / Gamma(1 - alpha), 0 < alpha < 1 (Scott Blair 1947), by its diffusive
/// representation (Yuan & Agrawal 2002): G within 0.3 % from `shortest_s` to `longest_s`. Rates thirty times faster
/// than `shortest_s` are left out, which takes a small dashpot away from the force of a ramp.
[[nodiscard]] std::vector<SpectralArm> springpot(double alpha, double shortest_s, double longest_s);
/// Log-normal spectrum about `time_s` with the width `decades` (Wagner 1913).
[[nodiscard]] std::vector<SpectralArm> log_normal(double time_s, double decades);
/// Stretched exponential exp(-sqrt(t / tau)) (Kohlrausch 1854; Williams & Watts 1970), by Pollard's spectrum (1946).
[[nodiscard]] std::vector<SpectralArm> kohlrausch_half(double time_s);
/// Relaxation function of a spectrum.
[[nodiscard]] double relaxation_at(std::span<const SpectralArm> arms, double t_s);
/// Force of the spectrum with the given stiffness, driven by any signal: sum of w (s - its first value) convolved
/// with exp(-t / tau). Exact for a signal that is straight between nodes.
[[nodiscard]] Signal relax(const Signal& t_s, const Signal& driving, std::span<const SpectralArm> arms,
                           double stiffness_N_mm);

// --- dashpot.cpp: an arm (spring k, linear time constant tau) whose dashpot is another one --------------------------

/// Flow in mm/s under a force; sizes from 0 (Newtonian, F / (k tau)).
using Flow = std::function<double(double force_N)>;
/// Eyring 1936: v = v0 sinh(F / F0), v0 = F0 / (k tau).
[[nodiscard]] Flow eyring(double viscosity_N_s_mm, double force_N);
/// Cross 1965 in force: viscosity eta / (1 + (|v| / v0)^m), solved for v.
[[nodiscard]] Flow cross(double viscosity_N_s_mm, double rate_mm_s, double exponent);
/// Carreau 1972: viscosity eta (1 + (v / v0)^2)^((n - 1) / 2), 0 < n <= 1.
[[nodiscard]] Flow carreau(double viscosity_N_s_mm, double rate_mm_s, double exponent);
/// Bingham regularised by Papanastasiou 1987: F = eta v + yield (1 - exp(-|v| / v0)) sgn v.
[[nodiscard]] Flow papanastasiou(double viscosity_N_s_mm, double yield_N, double rate_mm_s);
/// dz/dt = v - flow(k z), F = k z.
[[nodiscard]] Signal arm_force(const Drive& drive, double stiffness_N_mm, const Flow& flow);

// --- softening.cpp: what is taken off `elastic_N` --------------------------------------------------------------------

/// Ogden & Roxburgh 1999: share erf((W_max - W) / m) / r of the elastic force, W the work of the spring since rest.
[[nodiscard]] Signal ogden_roxburgh(const Drive& drive, double share, double energy_N_mm);
/// Simo 1987: damage share (1 - (1 - exp(-X / b)) / (X / b)), X the largest |elongation change| so far.
[[nodiscard]] Signal simo_damage(const Drive& drive, double share, double scale_mm);
/// Miehe 1995, the continuous part: share (1 - exp(-A / a)), A the accumulated |power| of the spring.
[[nodiscard]] Signal miehe_damage(const Drive& drive, double share, double energy_N_mm);

// --- kinematics.cpp: from the crosshead's position to the grip's ----------------------------------------------------

/// Play operators of spread widths up to `play_mm` (Krasnosel'skii & Pokrovskii 1989), weighted evenly.
[[nodiscard]] Signal spread_play(const Signal& position_mm, double play_mm);
/// Dead zone with a compliant, damped contact against a viscous guide: y' = D(x - y) / tau, D the dead zone of width
/// `play_mm` (Nordin & Gutman 2002). tau > 0.
[[nodiscard]] Signal compliant_play(const Drive& drive, double play_mm, double time_s);
/// Generalised play (Krasnosel'skii & Pokrovskii 1989): flanks x -+ w(x) / 2 that stand farther apart where a screw is
/// worn, w = play (1 + 2 exp(-(x / worn)^2)) / 3. Both flanks rise with x for play < 1.7 worn.
[[nodiscard]] Signal worn_play(const Signal& position_mm, double play_mm, double worn_mm);
struct SlipEvent {
  double at_s = 0.0;
  double share = 1.0;
};
/// Stick-slip: each event gives way exponentially over `time_s`.
[[nodiscard]] Signal stick_slips(const Signal& t_s, double slip_mm, std::span<const SlipEvent> events, double time_s);
/// Slip with afterslip that grows as the logarithm of time (Marone, Scholz & Bilham 1991).
[[nodiscard]] Signal afterslip(const Signal& t_s, double slip_mm, double at_s, double time_s);

// --- sensor.cpp: the load cell and what is mounted on it ------------------------------------------------------------

/// Two equal poles (critically damped), steady gain 1: a Bessel-like amplifier filter with the mean delay `lag_s`.
[[nodiscard]] Signal two_pole(const Drive& drive, const Signal& force_N, double lag_s);
/// Four equal poles, mean delay `lag_s` (cascade of buffers).
[[nodiscard]] Signal four_pole(const Drive& drive, const Signal& force_N, double lag_s);
/// Linear-phase FIR filter: raised cosine (Hann) window of the mean delay `delay_s`, its width twice that.
[[nodiscard]] Signal hann_filter(const Signal& t_s, const Signal& force_N, double delay_s);
/// Dead time that beats: the reading is between `delay_s` (1 - depth) and `delay_s` (1 + depth) old, a sawtooth with
/// `period_s` (two unsynchronised pollers; Nilsson 1998).
[[nodiscard]] Signal beating_delay(const Signal& t_s, const Signal& force_N, double delay_s, double depth,
                                   double period_s);
/// A mass on its own spring and damper: F = m a filtered by the resonance at `frequency_Hz` with `damping`.
[[nodiscard]] Signal sprung_mass(const Drive& drive, double mass_kg, double frequency_Hz, double damping);
/// Half of the mass rigid, the other half on it with a spring and a damper of its own (Den Hartog 1934, the vibration
/// absorber): F = m (a + y) / 2, y the acceleration of `sprung_mass`.
[[nodiscard]] Signal two_masses(const Drive& drive, double mass_kg, double frequency_Hz, double damping);
/// Momentum of a chain being lifted: d(m v)/dt with m = mass (1 + x / length) (Cayley 1857; Wong & Yasui 2006).
[[nodiscard]] Signal growing_mass(const Drive& drive, double mass_kg, double length_mm);
/// A specimen that lets go over a width: (F + sqrt(F^2 + w^2)) / 2 (a catenary near its sag; Irvine 1981).
[[nodiscard]] double hyperbolic_slack_N(double force_N, double width_N);
/// Bimodular: below zero only a share of the stiffness (Ambartsumyan 1965).
[[nodiscard]] double bimodular_N(double force_N, double share);
/// Analogue saturation, rounded over `width_N`: (F + c - sqrt((F - c)^2 + w^2)) / 2; digital noise comes on top.
[[nodiscard]] double saturated_N(double force_N, double ceiling_N, double width_N);
/// Hysteresis of a load cell: play operators in the force, each a share of `span_N`, subtracted (ISO 376
/// reversibility).
[[nodiscard]] Signal cell_hysteresis(const Signal& force_N, double share, double span_N);

// --- drift.cpp: zero drifts, functions of time that are near 1 at T; and pressures -----------------------------------
// T is where the recording ends that is fitted. In any other recording the drift is the same function of time.

/// ln(1 + t / t0) / ln(1 + T / t0): creep of a cell's adhesive (Andrade 1910; Nabarro 2001).
[[nodiscard]] Signal logarithmic_creep(const Signal& t_s, double time_s, double whole_s);
/// sqrt(t / T): heat that diffuses into a half space (Carslaw & Jaeger 1959).
[[nodiscard]] Signal diffusing_heat(const Signal& t_s, double whole_s);
/// A room between the two switching points of its thermostat, u' = (heater - u) / room_s, heater 1.5 or -0.5 with the
/// switching points 0 and 1, and an amplifier that follows it with amplifier_s.
[[nodiscard]] Signal thermostat(const Signal& t_s, double room_s, double amplifier_s);
/// Random walk with unit standard deviation at T, straight between knots 2 s apart (flicker-like wandering). A
/// recording of another length walks otherwise.
[[nodiscard]] Signal random_walk(const Signal& t_s, std::uint64_t seed, double whole_s);

/// What a volume of trapped gas does with motion: p' = -gamma p V'/V - (p - p0 V0/V) / heat_s in absolute pressure,
/// V/V0 = 1 - share (x - x0) / stroke: polytropic between isothermal and adiabatic (Kagawa 1985). Returns gauge psi.
[[nodiscard]] Signal trapped_gas(const Drive& drive, double gauge_psi, double share, double stroke_mm, double heat_s);
/// Valve hunting: triangle of the amplitude and period, with a leak's slope when filling and emptying differ.
[[nodiscard]] Signal hunting(const Signal& t_s, double amplitude_psi, double period_s, double rise_share);
/// Leak and refill: exponential loss with `leak_s`, filled again whenever `depth_psi` is lost; starts full.
[[nodiscard]] Signal leak_and_refill(const Signal& t_s, double gauge_psi, double leak_s, double depth_psi);
/// Regulator with droop: p' = -p / recovery + droop v.
[[nodiscard]] Signal regulator_droop(const Drive& drive, double droop_psi_mm, double recovery_s);

/// Ideal braid: F = force per psi times dp (3 (L / b)^2 - 1) / 2, L the length and b the thread's (Chou & Hannaford
/// 1996); L / b is the cosine of the angle between thread and axis. The factor vanishes at the neutral angle,
/// acos(1 / sqrt(3)) = 54.7 degrees, and is negative beyond it: there the braid lengthens with pressure.
[[nodiscard]] Signal braid_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double length_mm,
                                      double thread_mm);
/// F = c p0 ((p / p0)^m - 1) / m: curved in pressure (after Wickramatunge & Leephakpreeda 2010, who find squares).
[[nodiscard]] Signal power_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double exponent);
/// The bladder behind a tube: F' = (c dp - F) / tau (Richer & Hurmuzlu 2000).
[[nodiscard]] Signal tube_pressure_N(const Drive& drive, double force_N_psi, double nominal_psi, double time_s);

// --- outside.cpp: what nothing in the catalogue names ----------------------------------------------------------------

/// Eccentric gear: the grip runs ahead and behind by e sin(2 pi x / pitch) (position error; Ottewill et al. 2009).
[[nodiscard]] Signal eccentric_position(const Signal& position_mm, double eccentricity_mm, double pitch_mm);
/// Cogging of a permanent-magnet motor: sixth harmonic with its third (Zhu & Howe 2000).
[[nodiscard]] double cogging_N(double force_N, double position_mm, double pitch_mm);
/// A von Mises truss (1923), k w (1 - l0 / sqrt(a^2 + w^2)) with a = rise, behind a spring of a third of k: its apex w
/// jumps at one position and back at another. Flow of the apex: rate proportional to the unbalanced force, time
/// constant 10 ms.
[[nodiscard]] Signal snapping_truss(const Drive& drive, double stiffness_N_mm, double at_mm, double rise_mm);
[[nodiscard]] double von_mises_truss_N(double stiffness_N_mm, double apex_mm, double rise_mm);
/// Permanent set: the rest length grows by a share of what the largest extension so far exceeds `yield_mm` by (Guo &
/// Sluys 2008), and the force of the spring is that much less.
[[nodiscard]] Signal permanent_set(const Drive& drive, double share, double yield_mm);
/// Damping that differs between lengthening and shortening: c v for v > 0 only (Reynolds et al. 2003).
[[nodiscard]] Signal one_way_damping(const Drive& drive, double damping_N_s_mm);
/// Hunt & Crossley 1975: contact beyond `at_mm` with k d^1.5 (1 + c d').
[[nodiscard]] Signal bladder_contact(const Drive& drive, double stiffness_N_mm, double at_mm, double damping_s_mm);
/// Self-heating: F = -share heat specimen_N, heat' = |v| / travel_mm - heat / time_s (gains by rubbing; Gent & Hindi
/// 1988).
[[nodiscard]] Signal self_heating(const Drive& drive, double share, double travel_mm, double time_s);

}  // namespace isorig::proof::foreign
