#pragma once
#include <span>

namespace isorig::model {

/// Closed forms of the iso-velocity test on standard linear solid elements (SLSEs) in parallel.
///
/// Source: Bennington, Wang, Yin, Bergbreiter, Majidi, Webster-Wood, "Design and Characterization of
/// Viscoelastic McKibben Actuators with Tunable Force-Velocity Curves", eqs. (1)-(10). Element i, on the
/// strain eps of the pressurized rest length:
///     F_i = k1_i eps + k2_i eps2_i,      d(eps2_i)/dt = d(eps)/dt - gamma_i eps2_i,
///     kappa_i = k2_i / k1_i,             gamma_i = k2_i / eta_i,             beta_i = k1_i / k1_c.
/// The test: at rest at strain eps0 (eps2 = 0), then a constant rate until the strain has changed by deps.
///
/// Signs and units: extension and tension positive; rates in 1/s, signed; `strain_step` is a magnitude, > 0.
/// Where the print of the paper cannot be right (units of its ramp response, sign of the asymptote, range of
/// its v_alpha) this code follows the model, not the print: docs/force-velocity.md lists each place.
///
/// Valid for eps0 > 0 (a specimen under tension: forces are divided by k1 eps0), kappa, gamma, beta >= 0.
/// Exact: no step size enters. Relative rounding error below 1e-14, also for u = gamma deps / |rate| -> 0.

/// One element with its own units, for forces in newtons.
struct StandardLinearSolid {
  double k1_N = 0.0;     ///< spring across the element, newtons per unit strain
  double k2_N = 0.0;     ///< spring in series with the dashpot
  double eta_N_s = 0.0;  ///< dashpot
  [[nodiscard]] double kappa() const noexcept { return k2_N / k1_N; }
  [[nodiscard]] double gamma_per_s() const noexcept { return k2_N / eta_N_s; }
};

/// The same element as the force-velocity curve sees it. `beta` is k1 over the k1 of the reference (control)
/// element: 1 for the control itself.
struct FvElement {
  double kappa = 0.0;
  double gamma_per_s = 0.0;
  double beta = 1.0;
};

/// What all points of one force-velocity curve share.
struct FvTest {
  double strain_step = 0.0;     ///< deps > 0: magnitude of the strain applied by each ramp
  double initial_strain = 0.0;  ///< eps0 > 0: strain at the start, of the pressurized rest length
};

/// phi(u) = (1 - exp(-u)) / u, 1 at u = 0: the share of its elastic jump that a Maxwell arm still holds when
/// a ramp of duration u time constants ends.
[[nodiscard]] double maxwell_ramp_share(double u) noexcept;

/// Force at time t >= 0 of a ramp from rest (eq. 3, with the k2 that its print lacks):
///     F = k1 (eps0 + rate t) + eta rate (1 - exp(-t k2/eta)).
[[nodiscard]] double ramp_force_N(const StandardLinearSolid& element, double initial_strain, double rate_per_s,
                                  double t_s) noexcept;

/// Force at time t >= 0 after a ramp of duration `ramp_s` from rest has stopped: only the arm relaxes.
[[nodiscard]] double hold_force_N(const StandardLinearSolid& element, double initial_strain, double rate_per_s,
                                  double ramp_s, double t_s) noexcept;

/// Delta FV (eqs. 5, 8): height of the curve above its jump at rate 0, weighted by beta. Signed as the rate.
[[nodiscard]] double fv_height(std::span<const FvElement> elements, const FvTest& test, double rate_per_s) noexcept;

/// FV (eq. 4): peak force over the force before the ramp; 1 at rate 0, where the curve jumps by
/// +-deps/eps0.
[[nodiscard]] double force_velocity(std::span<const FvElement> elements, const FvTest& test,
                                    double rate_per_s) noexcept;

/// Delta FV for an infinitely fast extension (eqs. 6, 9); shortening has the same with a minus, which the
/// print leaves out.
[[nodiscard]] double fv_asymptote(std::span<const FvElement> elements, const FvTest& test) noexcept;

/// v_alpha (eqs. 7, 10): the rate (> 0) at which the height is alpha of its asymptote, by the paper's
/// first-order formula. Never below the exact rate. For one element the height that is reached at it is
/// within 5 % of alpha for alpha > 0.75 (what the paper claims), but the rate itself is 21 % too high there,
/// and within 5 % only for alpha > 0.93. With unequal gammas it is worse: docs/force-velocity.md has the
/// table.
[[nodiscard]] double rate_at_share_approximate(std::span<const FvElement> elements, const FvTest& test,
                                               double alpha) noexcept;

/// The same, exact: the root of fv_height = alpha * fv_asymptote. NaN unless 0 < alpha < 1 and some element
/// has kappa, gamma, beta > 0.
[[nodiscard]] double rate_at_share(std::span<const FvElement> elements, const FvTest& test, double alpha) noexcept;

/// Where a test stands on its own curve: the height at `rate_per_s` over the asymptote (0..1).
[[nodiscard]] double share_of_asymptote(std::span<const FvElement> elements, const FvTest& test,
                                        double rate_per_s) noexcept;

}  // namespace isorig::model
