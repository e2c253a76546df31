#include "identify/fv/fv_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/formatted.hpp"
#include "identify/fv/fv_problem.hpp"
#include "identify/fv/statistics.hpp"

namespace isorig::identify {
namespace {

using base::formatted;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// An interval of more than two decades is bounded, but identifies nothing.
constexpr double kWidest = 100.0;

/// Mean height of the points at one speed in units of the elastic jump J = deps / eps0: (+-(F / F0 - 1) - J) / J, which
/// the model makes kappa phi(u), kappa times the share of the asymptote.
double reduced_height(std::span<const FvPoint> points, double speed_per_s) {
  double sum = 0.0, count = 0.0;
  for (const FvPoint& p : points) {
    if (std::abs(std::abs(p.strain_rate_per_s) / speed_per_s - 1.0) > 0.1) continue;
    const double jump = p.strain_step / p.initial_strain;
    sum += (std::copysign(1.0, p.strain_rate_per_s) * (p.normalized_force - 1.0) - jump) / jump;
    count += 1.0;
  }
  return sum / count;
}

/// Distinct speeds, slowest first, those within 10 % counted once.
std::vector<double> speeds_of(std::span<const FvPoint> points) {
  std::vector<double> all, distinct;
  all.reserve(points.size());
  for (const FvPoint& p : points) all.push_back(std::abs(p.strain_rate_per_s));
  std::sort(all.begin(), all.end());
  for (double v : all)
    if (distinct.empty() || v > 1.1 * distinct.back()) distinct.push_back(v);
  return distinct;
}

/// The paper's starting values (eqs. 6 and 7), then gammas over the range that the speeds can see.
std::vector<std::array<double, 3>> starts(std::span<const FvPoint> points) {
  const auto speeds = speeds_of(points);
  const double step = points.front().strain_step;
  const double kappa = std::max(reduced_height(points, speeds.back()), 1e-3);
  const double probe = speeds[std::min<std::size_t>(1, speeds.size() - 1)];
  const double alpha = reduced_height(points, probe) / kappa;
  std::vector<double> gammas;
  if (alpha > 0.0 && alpha < 1.0) gammas.push_back(2.0 * (1.0 - alpha) * probe / step);
  for (double u : {0.03, 0.3, 3.0, 30.0}) gammas.push_back(u * std::sqrt(speeds.front() * speeds.back()) / step);
  std::vector<std::array<double, 3>> out;
  out.reserve(gammas.size());
  for (double gamma : gammas) out.push_back({std::log(kappa), std::log(gamma), 0.0});
  return out;
}

struct Profile {
  double low = -kInfinity;
  double high = kInfinity;
  std::vector<ProfilePoint> points;
};

/// Walks away from the optimum in growing steps of the logarithm until the limit is crossed or the bound
/// reached, then closes in on the crossing.
Profile profile(const FvProblem& problem, const std::array<double, 3>& best, double best_ssr, std::size_t k,
                double limit) {
  Profile out;
  out.points.push_back({std::exp(best[k]), best_ssr});
  for (const double sign : {-1.0, 1.0}) {
    const double bound = sign < 0 ? problem.bounds(k).low : problem.bounds(k).high;
    std::array<double, 3> at = best, inside = best;
    double step = 0.02;
    bool crossed = false;
    for (int i = 0; i < 60; ++i) {
      std::array<double, 3> next = at;
      next[k] += sign * step;
      if (sign * (next[k] - bound) >= 0.0) next[k] = bound;
      const double ssr = problem.solve(next, static_cast<int>(k));
      out.points.push_back({std::exp(next[k]), ssr});
      inside = at;
      at = next;
      if (ssr > limit) {
        crossed = true;
        break;
      }
      if (next[k] == bound) break;
      step = std::min(1.5 * step, 0.7);
    }
    if (!crossed) continue;
    for (int i = 0; i < 30 && std::abs(at[k] - inside[k]) > 1e-4; ++i) {
      std::array<double, 3> middle = inside;
      middle[k] = 0.5 * (at[k] + inside[k]);
      if (problem.solve(middle, static_cast<int>(k)) > limit)
        at = middle;
      else
        inside = middle;
    }
    (sign < 0 ? out.low : out.high) = std::exp(0.5 * (at[k] + inside[k]));
  }
  std::sort(out.points.begin(), out.points.end(),
            [](const ProfilePoint& a, const ProfilePoint& b) { return a.value < b.value; });
  return out;
}

/// Why a side of the interval is open, in terms of where the tested speeds lie on the curve.
std::string explain(const FittedParameter& p, const FvFit& fit, std::span<const FvPoint> points, bool sheath) {
  const std::string subject = "The " + std::string(words_of(p.name).words) + " [" + p.name + "]";
  if (p.identifiable) {
    if (p.high > 10.0 * p.low)
      return formatted("%s is known only to a factor of %.0f from these velocities.", subject.c_str(), p.high / p.low);
    return {};
  }
  const auto speeds = speeds_of(points);
  const model::FvElement& e = fit.elements.back();
  const double u_slow = e.gamma_per_s * points.front().strain_step / speeds.front();
  const double slow = model::maxwell_ramp_share(u_slow);
  const double fast = model::maxwell_ramp_share(e.gamma_per_s * points.front().strain_step / speeds.back());
  const bool low = std::isfinite(p.low), high = std::isfinite(p.high);
  const std::string unit = words_of(p.name).unit.empty() ? "" : " " + std::string(words_of(p.name).unit);
  const std::string range = low && high ? formatted("only that it lies between %.2g and %.2g", p.low, p.high)
                            : high      ? formatted("only that it is below %.3g", p.high)
                            : low       ? formatted("only that it is above %.3g", p.low)
                                        : std::string("nothing");
  std::string why;
  if (speeds.size() < 2)
    why = "all ramps have one speed";
  else if (slow > 0.9)
    why = formatted(
        "even the slowest ramp (%.3g 1/s) is at %.0f %% of the asymptote, so the steep part of the curve was "
        "not visited; slower ramps would settle it",
        speeds.front(), 100.0 * slow);
  else if (fast < 0.3)
    why = formatted(
        "even the fastest ramp (%.3g 1/s) is at %.0f %% of the asymptote, so the curve is still a line; "
        "faster "
        "ramps would settle it",
        speeds.back(), 100.0 * fast);
  else if (sheath)
    why = "the sheath's share of the curve cannot be told from a change of its other parameters";
  else
    why = "the scatter of the points is as large as the curve";
  return subject + " is not identifiable from these velocities: " + range + (low || high ? unit : "") +
         " can be said (95 %), because " + why + ".";
}

FvFitResult fit(std::span<const FvPoint> points, std::optional<model::FvElement> control) {
  FvFitResult result;
  const std::size_t parameters = control ? 3 : 2;
  for (const FvPoint& p : points)
    if (!(p.initial_strain > 0.0) || !(p.strain_step > 0.0) || p.strain_rate_per_s == 0.0 ||
        !std::isfinite(p.normalized_force)) {
      result.refusal = "No fit: the specimen is not under tension at the start of its ramps (initial strain " +
                       formatted("%.4g", p.initial_strain) +
                       "), and the model divides by that strain. Are rest_length_mm and "
                       "pressurized_rest_length_mm right?";
      return result;
    }
  if (points.size() < parameters + 1) {
    result.refusal = "No fit: " + std::to_string(points.size()) +
                     (points.size() == 1 ? " usable ramp" : " usable ramps") + ", and " + std::to_string(parameters) +
                     " parameters with a measure of their error need at least " + std::to_string(parameters + 1) + ".";
    return result;
  }
  const FvProblem problem(points, control);
  std::array<double, 3> best{};
  double ssr = kInfinity;
  for (auto start : starts(points)) {
    const double value = problem.solve(start);
    if (value < ssr) {
      ssr = value;
      best = start;
    }
  }
  FvFit fit;
  fit.points = points.size();
  fit.elements = problem.elements(best);
  const double n = static_cast<double>(points.size());
  double mean = 0.0, measured_variance = 0.0;
  for (const FvPoint& p : points) {
    mean += p.normalized_force / n;
    if (std::isfinite(p.standard_error)) measured_variance += p.standard_error * p.standard_error / n;
  }
  double spread = 0.0;
  std::array<double, 2> side_sum{}, side_count{};
  for (const FvPoint& p : points) {
    const model::FvTest test{p.strain_step, p.initial_strain};
    const double residual = p.normalized_force - model::force_velocity(fit.elements, test, p.strain_rate_per_s);
    fit.residuals.push_back(residual);
    spread += (p.normalized_force - mean) * (p.normalized_force - mean);
    const std::size_t side = p.strain_rate_per_s > 0 ? 0 : 1;
    side_sum[side] += residual;
    side_count[side] += 1.0;
  }
  fit.mean_residual_extension = side_count[0] > 0 ? side_sum[0] / side_count[0] : 0.0;
  fit.mean_residual_shortening = side_count[1] > 0 ? side_sum[1] / side_count[1] : 0.0;
  fit.r_squared = spread > 0.0 ? 1.0 - ssr / spread : std::numeric_limits<double>::quiet_NaN();
  // Worse than the points' own mean: no parameter of such a curve means anything.
  if (fit.r_squared < 0.0) {
    result.refusal =
        "No fit: the points follow no force-velocity curve of this model; their own mean describes "
        "them better than the best one does. Is the force zeroed, and are the rest lengths right?";
    return result;
  }
  fit.residual_rms = std::sqrt(ssr / n);
  const double freedom = n - static_cast<double>(parameters);
  // A parameter's 95 % interval ends where the sum of squares, all others refitted, exceeds SSR + s^2 t^2, t Student's
  // at 97.5 % with n - p degrees of freedom; s^2 = max(SSR / (n - p), mean square of the points' own standard errors).
  fit.noise = std::sqrt(std::max(ssr / freedom, measured_variance));
  const double t = student_t_quantile(0.975, freedom);
  fit.profile_limit = ssr + fit.noise * fit.noise * t * t;
  const std::array<const char*, 3> names{"kappa", "gamma_per_s", "beta"};
  for (std::size_t k = 0; k < parameters; ++k) {
    const Profile p = profile(problem, best, ssr, k, fit.profile_limit);
    FittedParameter parameter;
    parameter.name = names[k];
    parameter.value = std::exp(best[k]);
    parameter.low = p.low;
    parameter.high = p.high;
    parameter.identifiable = std::isfinite(p.low) && std::isfinite(p.high) && p.high < kWidest * p.low;
    parameter.profile = p.points;
    parameter.statement = explain(parameter, fit, points, control.has_value());
    if (!parameter.statement.empty()) fit.statements.push_back(parameter.statement);
    fit.parameters.push_back(std::move(parameter));
  }
  result.fit = std::move(fit);
  return result;
}

/// The zero that drifts is fitted as well, and every interval reaches over both fits.
FvFitResult fit_both_zeros(std::span<const FvPoint> points, std::optional<model::FvElement> control) {
  FvFitResult result = fit(points, control);
  std::vector<FvPoint> steady(points.begin(), points.end());
  bool wanders = false;
  for (FvPoint& p : steady) {
    wanders = wanders || p.normalized_force_if_zero_drifts.has_value();
    p.normalized_force = p.normalized_force_if_zero_drifts.value_or(p.normalized_force);
  }
  if (!wanders || !result.fit) return result;
  const FvFitResult other = fit(steady, control);
  FvFit& stated = *result.fit;
  stated.statements.clear();
  std::string values;
  for (std::size_t k = 0; k < stated.parameters.size(); ++k) {
    FittedParameter& p = stated.parameters[k];
    p.low = other.fit ? std::min(p.low, other.fit->parameters[k].low) : -kInfinity;
    p.high = other.fit ? std::max(p.high, other.fit->parameters[k].high) : kInfinity;
    p.identifiable = std::isfinite(p.low) && std::isfinite(p.high) && p.high < kWidest * p.low;
    p.statement = explain(p, stated, points, control.has_value());
    if (!p.statement.empty()) stated.statements.push_back(p.statement);
    if (!other.fit) continue;
    values += (values.empty() ? "" : ", ") + p.name + formatted(" = %.3g", other.fit->parameters[k].value);
  }
  stated.statements.push_back(
      other.fit ? "The force at rest wanders from ramp to ramp. If the zero drifted, " + values +
                      "; the intervals reach over both."
                : "The force at rest wanders from ramp to ramp. If the zero drifted, there is no fit, so that nothing "
                  "is stated as known.");
  return result;
}

}  // namespace

ParameterWords words_of(std::string_view parameter) {
  if (parameter == "kappa") return {"κ", "", "stiffness of the Maxwell arm over the spring's"};
  if (parameter == "gamma_per_s") return {"γ", "1/s", "relaxation rate of the Maxwell arm"};
  if (parameter == "beta") return {"β", "", "stiffness of the sheath's spring over the control's"};
  return {parameter, "", parameter};
}

const FittedParameter& FvFit::parameter(std::string_view name) const {
  for (const auto& p : parameters)
    if (p.name == name) return p;
  throw std::out_of_range("no parameter '" + std::string(name) + "' in this fit");
}

std::vector<FvPoint> points_of(std::span<const Ramp> ramps) {
  std::vector<FvPoint> points;
  for (const Ramp& r : ramps)
    if (r.usable())
      points.push_back({r.strain_rate_per_s->value, r.normalized_force->value, r.normalized_force->standard_error,
                        *r.initial_strain, std::abs(*r.strain_step), r.normalized_force_if_zero_drifts});
  return points;
}

FvFitResult fit_control(std::span<const FvPoint> points) {
  return fit_both_zeros(points, std::nullopt);
}

FvFitResult fit_sheath(std::span<const FvPoint> points, const model::FvElement& control) {
  return fit_both_zeros(points, control);
}

}  // namespace isorig::identify
