#pragma once
#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "identify/fv/fv_fit.hpp"
#include "model/force_velocity.hpp"

/// Within this room alone: fit_control and fit_sheath (fv_fit.hpp) are what others call.
namespace isorig::identify {

/// phi(u) = (1 - e^-u) / u for Ceres' dual numbers (model::maxwell_ramp_share is for doubles).
template <typename T>
T ramp_share(const T& u) {
  using std::exp;
  // The next term of the series is u^6/5040, at most 1.3e-14: what 1 - e^-u loses to cancellation there is as much.
  if (u < T(0.02)) {
    return T(1.0) - u / 2.0 * (T(1.0) - u / 3.0 * (T(1.0) - u / 4.0 * (T(1.0) - u / 5.0 * (T(1.0) - u / 6.0))));
  }
  return (T(1.0) - exp(-u)) / u;
}

/// A point's residual as a function of log kappa, log gamma and, with a control held, log beta (eqs. 4 and 8):
///
///     1 + sgn(v) deps / eps0 (1 + height) - F / F0,   height = kappa phi(u),   u = gamma deps / |v|
///     with a control c:   height = (kappa_c phi(u_c) + beta kappa phi(u)) / (1 + beta)
struct PointCost {
  FvPoint point;
  std::optional<model::FvElement> control;

  template <typename T>
  bool operator()(const T* log_kappa, const T* log_gamma, T* residual) const {
    residual[0] = difference(log_kappa[0], log_gamma[0], T(1.0), T(0.0));
    return true;
  }
  template <typename T>
  bool operator()(const T* log_kappa, const T* log_gamma, const T* log_beta, T* residual) const {
    using std::exp;
    const T beta = exp(log_beta[0]);
    const double u = control->gamma_per_s * point.strain_step / std::abs(point.strain_rate_per_s);
    const T held(control->kappa * model::maxwell_ramp_share(u));
    residual[0] = difference(log_kappa[0], log_gamma[0], beta / (T(1.0) + beta), held / (T(1.0) + beta));
    return true;
  }

 private:
  template <typename T>
  T difference(const T& log_kappa, const T& log_gamma, const T& weight, const T& held) const {
    using std::exp;
    const T u = exp(log_gamma) * (point.strain_step / std::abs(point.strain_rate_per_s));
    const T height = held + weight * exp(log_kappa) * ramp_share(u);
    const double scale = std::copysign(point.strain_step / point.initial_strain, point.strain_rate_per_s);
    return T(1.0) + T(scale) * (T(1.0) + height) - T(point.normalized_force);
  }
};

struct LogBounds {
  double low, high;
};

/// Least squares of an element's numbers, as logarithms, to a curve's points.
class FvProblem {
 public:
  FvProblem(std::span<const FvPoint> points, std::optional<model::FvElement> control)
      : points_(points), control_(control) {
    double slowest = std::numeric_limits<double>::infinity(), fastest = 0.0;
    for (const FvPoint& p : points) {
      slowest = std::min(slowest, std::abs(p.strain_rate_per_s) / p.strain_step);
      fastest = std::max(fastest, std::abs(p.strain_rate_per_s) / p.strain_step);
    }
    // u = gamma deps / rate from 1e-4 at the slowest ramp (a step) to 1e4 at the fastest (a line): beyond
    // either, the curve does not change by what any recording resolves.
    bounds_ = {{{std::log(1e-5), std::log(1e5)},
                {std::log(1e-4 * slowest), std::log(1e4 * fastest)},
                {std::log(1e-4), std::log(1e4)}}};
  }

  [[nodiscard]] std::size_t size() const { return control_ ? 3 : 2; }
  [[nodiscard]] const LogBounds& bounds(std::size_t k) const { return bounds_[k]; }

  /// Refines `logs`; parameter `held` stays. Returns the sum of squares.
  double solve(std::array<double, 3>& logs, int held = -1) const {
    ceres::Problem problem;
    for (std::size_t k = 0; k < size(); ++k) {
      logs[k] = std::clamp(logs[k], bounds_[k].low, bounds_[k].high);
      problem.AddParameterBlock(&logs[k], 1);
      problem.SetParameterLowerBound(&logs[k], 0, bounds_[k].low);
      problem.SetParameterUpperBound(&logs[k], 0, bounds_[k].high);
    }
    for (const FvPoint& p : points_) {
      auto* cost = new PointCost{p, control_};
      if (control_)
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PointCost, 1, 1, 1, 1>(cost), nullptr, &logs[0],
                                 &logs[1], &logs[2]);
      else
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PointCost, 1, 1, 1>(cost), nullptr, &logs[0],
                                 &logs[1]);
    }
    if (held >= 0) problem.SetParameterBlockConstant(&logs[static_cast<std::size_t>(held)]);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-12;
    options.parameter_tolerance = 1e-10;
    options.gradient_tolerance = 1e-16;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return 2.0 * summary.final_cost;
  }

  [[nodiscard]] std::vector<model::FvElement> elements(const std::array<double, 3>& logs) const {
    if (!control_) return {{std::exp(logs[0]), std::exp(logs[1]), 1.0}};
    return {{control_->kappa, control_->gamma_per_s, 1.0}, {std::exp(logs[0]), std::exp(logs[1]), std::exp(logs[2])}};
  }

 private:
  std::span<const FvPoint> points_;
  std::optional<model::FvElement> control_;
  std::array<LogBounds, 3> bounds_{};
};

}  // namespace isorig::identify
