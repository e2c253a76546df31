#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "identify/fv/ramps.hpp"
#include "model/force_velocity.hpp"

namespace isorig::identify {

/// Fits of the closed forms in model/force_velocity.hpp to force-velocity points, as in the section
/// "Analysis" of the paper: kappa_c and gamma_c of a control actuator; kappa_s, gamma_s and
/// beta_s of a sheath with the control's parameters held.
///
/// Least squares with equal weights: every point's own eps0 and deps enter. Parameters are positive and are
/// fitted and profiled as logarithms. Starting values: the paper's (kappa from the fastest ramps as if they
/// were on the asymptote, gamma from the second slowest through v_alpha, beta_s = 1), and a few more gammas,
/// because the paper's are undefined when the second slowest point lies above the fastest.
///
/// An interval is a profile-likelihood interval (all other parameters refitted; Raue et al. 2009), with the
/// residual scatter or the points' own standard errors, whichever is larger, as noise. Where the sum of
/// squares stays below its limit all the way to a bound, that side is open and the parameter is called not
/// identifiable from these velocities, with the reason. The control's own uncertainty is not in the sheath's
/// intervals. Where the force at rest wanders from ramp to ramp, an interval reaches over that of a second fit, to the
/// points as they are if the zero drifted.

struct FvPoint {
  double strain_rate_per_s = 0.0;  ///< extension positive
  double normalized_force = 0.0;
  double standard_error = 0.0;
  double initial_strain = 0.0;  ///< eps0 > 0
  double strain_step = 0.0;     ///< deps > 0, a magnitude
  std::optional<double> normalized_force_if_zero_drifts{};
};

/// Of the usable ramps.
[[nodiscard]] std::vector<FvPoint> points_of(std::span<const Ramp> ramps);

struct ProfilePoint {
  double value = 0.0;
  double sum_of_squares = 0.0;
};

struct FittedParameter {
  std::string name;  ///< "kappa", "gamma_per_s", "beta"
  double value = 0.0;
  /// 95 %; -infinity (0 for a positive parameter is never reached) and +infinity where the profile stays
  /// open.
  double low = 0.0;
  double high = 0.0;
  bool identifiable = false;          ///< both ends known, less than two decades apart; else `value` means little
  std::string statement;              ///< empty when there is nothing to say
  std::vector<ProfilePoint> profile;  ///< increasing value
};

/// How a parameter is called in front of people.
struct ParameterWords {
  std::string_view symbol;  ///< "κ"
  std::string_view unit;    ///< "" of a ratio
  std::string_view words;   ///< "stiffness of the Maxwell arm over the spring's"
};
/// By FittedParameter::name.
[[nodiscard]] ParameterWords words_of(std::string_view parameter);

struct FvFit {
  std::vector<FittedParameter> parameters;
  std::vector<model::FvElement> elements;  ///< control first
  std::size_t points = 0;
  double r_squared = 0.0;         ///< of the points round their mean; NaN when they have no spread
  double residual_rms = 0.0;      ///< of F/F0
  double noise = 0.0;             ///< that the intervals are based on
  double profile_limit = 0.0;     ///< sum of squares at the 95 % limit
  std::vector<double> residuals;  ///< measured minus model, in the order of the points
  /// Mean residuals (measured minus model). Positive in extension: the model under-predicts the response;
  /// positive in shortening: it over-predicts it (the measured force falls less than the model's).
  double mean_residual_extension = 0.0;
  double mean_residual_shortening = 0.0;
  std::vector<std::string> statements;
  [[nodiscard]] const FittedParameter& parameter(std::string_view name) const;
};

/// A fit, or why there is none ("1 ramp is not enough ...").
struct FvFitResult {
  std::optional<FvFit> fit;
  std::string refusal;
};

[[nodiscard]] FvFitResult fit_control(std::span<const FvPoint> points);
[[nodiscard]] FvFitResult fit_sheath(std::span<const FvPoint> points, const model::FvElement& control);

}  // namespace isorig::identify
