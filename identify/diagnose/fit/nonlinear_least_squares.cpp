#include "identify/diagnose/fit/nonlinear_least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace isorig::identify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastGain = 1e-3;
/// Shares of the mean square by which a promise counts as kept.
constexpr double kPromise = 0.05;

/// The problem about one point: |J s + r|^2 = |R s + z|^2 + what no step takes away, of the coordinates that move.
struct Linear {
  std::vector<Index> moving;
  MatrixXd r;
  VectorXd z;
  VectorXd length;  ///< of J's columns
  bool held = false;

  [[nodiscard]] VectorXd step(double damping, Index width) const {
    const auto k = static_cast<Index>(moving.size());
    MatrixXd stack(r.rows() + k, k);
    stack.topRows(r.rows()) = r;
    stack.bottomRows(k) = MatrixXd((std::sqrt(damping) * length).asDiagonal());
    VectorXd right = VectorXd::Zero(stack.rows());
    right.head(z.size()) = -z;
    const VectorXd s = Eigen::CompleteOrthogonalDecomposition<MatrixXd>(stack).solve(right);
    VectorXd out = VectorXd::Zero(width);
    for (Index i = 0; i < k; ++i) out[moving[i]] = s[i];
    return out;
  }
  /// What a step takes off the squares if the problem is as linear as it looks.
  [[nodiscard]] double promised(const VectorXd& step) const {
    VectorXd s(static_cast<Index>(moving.size()));
    for (Index i = 0; i < s.size(); ++i) s[i] = step[moving[i]];
    return z.squaredNorm() - (r * s + z).squaredNorm();
  }
};

Linear linearise(const LeastSquaresProblem& problem, const VectorXd& u, const VectorXd& residual,
                 LeastSquaresResult& out) {
  const VectorXd steps = problem.difference_steps(u);
  MatrixXd jacobian(residual.size(), u.size());
  VectorXd moved_residual;
  for (Index i = 0; i < u.size(); ++i) {
    VectorXd moved = u;
    moved[i] += steps[i];
    problem.residual(moved, moved_residual);
    ++out.evaluations;
    jacobian.col(i) = (moved_residual - residual) / (moved[i] - u[i]);
  }
  const VectorXd gradient = jacobian.transpose() * residual;
  Linear linear;
  for (Index i = 0; i < u.size(); ++i) {
    const bool pushed_out =
        (u[i] <= problem.lower[i] && gradient[i] > 0.0) || (u[i] >= problem.upper[i] && gradient[i] < 0.0);
    if (pushed_out)
      linear.held = true;
    else
      linear.moving.push_back(i);
  }
  const auto k = static_cast<Index>(linear.moving.size());
  MatrixXd columns(residual.size(), k);
  for (Index i = 0; i < k; ++i) columns.col(i) = jacobian.col(linear.moving[i]);
  linear.length = columns.colwise().norm().transpose();
  const Index rows = std::min(columns.rows(), k);
  const Eigen::HouseholderQR<MatrixXd> qr(columns);
  linear.r = qr.matrixQR().topRows(rows).triangularView<Eigen::Upper>();
  linear.z = VectorXd(qr.householderQ().adjoint() * residual).head(rows);
  return linear;
}

}  // namespace

std::string_view name_of(Stop stop) noexcept {
  switch (stop) {
    case Stop::kConverged:
      return "converged";
    case Stop::kAtBounds:
      return "at_bounds";
    case Stop::kNoProgress:
      return "no_progress";
    case Stop::kIterationLimit:
      return "iteration_limit";
  }
  return "";
}

LeastSquaresResult minimise_squares(const LeastSquaresProblem& problem, VectorXd u, int iterations) {
  constexpr int kAttempts = 8;
  constexpr double kCautious = 0.1;  // damping above which a short step says little about what is left to gain
  constexpr double kLeastDamping = 1e-16;
  LeastSquaresResult out;
  u = u.cwiseMax(problem.lower).cwiseMin(problem.upper);
  problem.residual(u, out.residual);
  problem.accepted();
  out.squares = out.residual.squaredNorm();
  out.evaluations = 1;
  out.u = u;
  if (u.size() == 0) return out;
  out.stop = Stop::kIterationLimit;
  double damping = 1e-2;
  int creeping = 0;
  VectorXd residual;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    const Linear linear = linearise(problem, out.u, out.residual, out);
    const Stop done = linear.held ? Stop::kAtBounds : Stop::kConverged;
    out.stop = done;
    if (linear.moving.empty()) return out;
    const double counts = kPromise * std::max(1.0, out.squares / static_cast<double>(out.residual.size()));
    double first_promise = 0.0, gained = 0.0, moved_by = 0.0, used = damping;
    bool improved = false;
    double harder = 6.0;
    for (int attempt = 0; attempt < kAttempts && !improved; ++attempt) {
      VectorXd next =
          out.u + linear.step(damping, u.size()).cwiseMax(-problem.longest_step).cwiseMin(problem.longest_step);
      next = next.cwiseMax(problem.lower).cwiseMin(problem.upper);
      const double promise = linear.promised(next - out.u);
      if (attempt == 0) first_promise = promise;
      problem.residual(next, residual);
      ++out.evaluations;
      const double squares = residual.squaredNorm();
      used = damping;
      if (!(squares < out.squares)) {
        damping *= harder;
        harder *= 2.0;  // Nielsen 1999: from the least damping to a gradient step in eight attempts
        continue;
      }
      problem.accepted();
      improved = true;
      gained = out.squares - squares;
      moved_by = (next - out.u).norm();
      out.u = std::move(next);
      out.squares = squares;
      out.residual = residual;
      // Where the promise was kept the next step may trust it more: a long valley is walked in few steps.
      damping = std::max(damping * (gained > 0.9 * promise ? 0.02 : 0.2), kLeastDamping);
    }
    if (!improved) {
      if (first_promise >= counts) out.stop = Stop::kNoProgress;
      return out;
    }
    const bool little = gained < kLeastGain || (gained < kPromise && moved_by < 1e-4);
    if (!little) {
      creeping = 0;
      out.stop = Stop::kIterationLimit;
      continue;
    }
    if (used <= kCautious || first_promise < counts) return out;
    if (++creeping == 2) {
      out.stop = Stop::kNoProgress;
      return out;
    }
    out.stop = Stop::kIterationLimit;
  }
  return out;
}

}  // namespace isorig::identify
