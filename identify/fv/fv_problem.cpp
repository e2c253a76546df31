#include "identify/fv/fv_problem.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace isorig::identify {
namespace {

constexpr int kIterations = 100;
/// A step that lowers the sum of squares by less than this share of it is the last ...
constexpr double kLeastGain = 1e-12;
/// ... and one that changes no logarithm by more than this is not taken any more.
constexpr double kLeastStep = 1e-10;
/// Of a logarithm: slopes here say nothing of a curve a factor of 20 away, where it may be flat for good.
constexpr double kLongestStep = 3.0;
/// Of the curvature: keeps its factors real where two parameters do the same.
constexpr double kLeastDamping = 1e-10;

}  // namespace

/// Sum of squares of the residuals r, J'r and J'J. Two or three numbers of a well-scaled curve: the normal equations
/// give a step that is good enough, and where the search ends depends on J'r alone.
struct FvProblem::Squares {
  double sum = 0.0;
  Eigen::Vector3d slope = Eigen::Vector3d::Zero();
  Eigen::Matrix3d curvature = Eigen::Matrix3d::Zero();
};

FvProblem::FvProblem(std::span<const FvPoint> points, std::optional<model::FvElement> control) : control_(control) {
  double slowest = std::numeric_limits<double>::infinity(), fastest = 0.0;
  rows_.reserve(points.size());
  for (const FvPoint& p : points) {
    Row row;
    row.duration = p.strain_step / std::abs(p.strain_rate_per_s);
    row.jump = std::copysign(p.strain_step / p.initial_strain, p.strain_rate_per_s);
    row.excess = p.normalized_force - 1.0 - row.jump;
    if (control_) row.held = control_->kappa * model::maxwell_ramp_share(control_->gamma_per_s * row.duration);
    rows_.push_back(row);
    slowest = std::min(slowest, 1.0 / row.duration);
    fastest = std::max(fastest, 1.0 / row.duration);
  }
  // u = gamma deps / rate from 1e-4 at the slowest ramp (a step) to 1e4 at the fastest (a line): beyond
  // either, the curve does not change by what any recording resolves.
  bounds_ = {{{std::log(1e-5), std::log(1e5)},
              {std::log(1e-4 * slowest), std::log(1e4 * fastest)},
              {std::log(1e-4), std::log(1e4)}}};
}

FvProblem::Squares FvProblem::squares(const std::array<double, 3>& logs) const {
  const double kappa = std::exp(logs[0]), gamma_per_s = std::exp(logs[1]);
  const double beta = control_ ? std::exp(logs[2]) : 0.0;
  // Of the element and of the control in the curve.
  const double weight = control_ ? beta / (1.0 + beta) : 1.0, rest = control_ ? 1.0 / (1.0 + beta) : 0.0;
  Squares out;
  for (const Row& row : rows_) {
    const double u = gamma_per_s * row.duration;
    const double lost = -std::expm1(-u), share = lost / u;
    const double own = row.jump * weight * kappa;
    const double residual = own * share + row.jump * rest * row.held - row.excess;
    // d phi / d ln u = e^-u - phi;   d weight / d ln beta = weight / (1 + beta)
    const Eigen::Vector3d slope{own * share, own * ((1.0 - lost) - share),
                                row.jump * weight * rest * (kappa * share - row.held)};
    out.sum += residual * residual;
    out.slope += residual * slope;
    out.curvature += slope * slope.transpose();
  }
  return out;
}

double FvProblem::sum_of_squares(const std::array<double, 3>& logs) const {
  return squares(logs).sum;
}

/// The step of least squares from `logs`, at `damping`, that ends within the bounds: a parameter that it would carry
/// out goes to its bound, and the others are solved for again, with that. None: the curvature has no factors.
std::optional<Eigen::Vector3d> FvProblem::step_within(const Squares& now, const std::array<double, 3>& logs, int held,
                                                      double damping) const {
  std::array<bool, 3> fixed{};
  Eigen::Vector3d step = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    const double slope = now.slope[static_cast<Eigen::Index>(k)];
    fixed[k] = k >= size() || static_cast<int>(k) == held || (logs[k] <= bounds_[k].low && slope > 0.0) ||
               (logs[k] >= bounds_[k].high && slope < 0.0);
  }
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix3d curvature = now.curvature;
    Eigen::Vector3d wanted = -now.slope;
    for (int k = 0; k < 3; ++k)
      if (fixed[static_cast<std::size_t>(k)]) wanted -= now.curvature.col(k) * step[k];
    for (int k = 0; k < 3; ++k) {
      if (fixed[static_cast<std::size_t>(k)]) {
        curvature.row(k).setZero();
        curvature.col(k).setZero();
        curvature(k, k) = 1.0;
        wanted[k] = step[k];
      } else {
        curvature(k, k) += damping * curvature(k, k) + std::numeric_limits<double>::min();
      }
    }
    const Eigen::LLT<Eigen::Matrix3d> factors(curvature);
    if (factors.info() != Eigen::Success) return std::nullopt;
    step = factors.solve(wanted);
    if (const double longest = step.cwiseAbs().maxCoeff(); longest > kLongestStep) step *= kLongestStep / longest;
    bool leaves = false;
    for (std::size_t k = 0; k < size(); ++k) {
      double& taken = step[static_cast<Eigen::Index>(k)];
      const double within = std::clamp(logs[k] + taken, bounds_[k].low, bounds_[k].high) - logs[k];
      if (fixed[k] || within == (logs[k] + taken) - logs[k]) continue;
      taken = within;
      fixed[k] = leaves = true;
    }
    if (!leaves) break;
  }
  return step;
}

// Levenberg-Marquardt, damped in units of the curvature (Marquardt 1963), the damping by Nielsen's rule (Madsen,
// Nielsen & Tingleff 2004, 3.2). Written out, because what a general solver sets up for a problem takes longer than ten
// points and two numbers do.
double FvProblem::solve(std::array<double, 3>& logs, int held) const {
  for (std::size_t k = 0; k < size(); ++k) logs[k] = std::clamp(logs[k], bounds_[k].low, bounds_[k].high);
  Squares now = squares(logs);
  double damping = 1e-4, growth = 2.0;
  for (int i = 0; i < kIterations; ++i) {
    const auto step = step_within(now, logs, held, damping);
    if (step && !(step->cwiseAbs().maxCoeff() >= kLeastStep)) break;
    std::array<double, 3> next = logs;
    for (std::size_t k = 0; step && k < size(); ++k)
      next[k] = std::clamp(logs[k] + (*step)[static_cast<Eigen::Index>(k)], bounds_[k].low, bounds_[k].high);
    const Squares then = step ? squares(next) : now;
    if (!(then.sum < now.sum)) {
      damping *= growth;
      growth *= 2.0;
      continue;
    }
    const double gain = now.sum - then.sum;
    const double foreseen = -step->dot(2.0 * now.slope + now.curvature * *step);
    const double agreement = foreseen > 0.0 ? 2.0 * gain / foreseen - 1.0 : 0.0;
    damping = std::max(kLeastDamping, damping * std::clamp(1.0 - std::pow(agreement, 3), 1.0 / 3.0, 2.0));
    growth = 2.0;
    const bool settled = gain < kLeastGain * now.sum;
    logs = next;
    now = then;
    if (settled) break;
  }
  return now.sum;
}

std::vector<model::FvElement> FvProblem::elements(const std::array<double, 3>& logs) const {
  if (!control_) return {{std::exp(logs[0]), std::exp(logs[1]), 1.0}};
  return {{control_->kappa, control_->gamma_per_s, 1.0}, {std::exp(logs[0]), std::exp(logs[1]), std::exp(logs[2])}};
}

}  // namespace isorig::identify
