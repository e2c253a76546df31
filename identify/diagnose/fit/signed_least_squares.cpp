#include "identify/diagnose/fit/signed_least_squares.hpp"

#include <cmath>

namespace isorig::identify {

using model::Sign;

// With D the lengths of A's columns: A'A = D C D, C = L L' (Cholesky), so R = L'D and z = L^-1 D^-1 A'b.
bool reduce_normal_equations(const Eigen::MatrixXd& gram, const Eigen::VectorXd& right, Reduced& out) {
  constexpr double kLeastCondition = 1e-8;
  const Eigen::Index m = gram.rows();
  Eigen::VectorXd length(m);
  for (Eigen::Index i = 0; i < m; ++i) length[i] = gram(i, i) > 0.0 ? std::sqrt(gram(i, i)) : 1.0;
  Eigen::MatrixXd scaled = length.cwiseInverse().asDiagonal() * gram * length.cwiseInverse().asDiagonal();
  // An empty column (play that swallows all motion) is none; it is left out of the condition.
  for (Eigen::Index i = 0; i < m; ++i)
    if (gram(i, i) <= 0.0) scaled(i, i) = 1.0;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(scaled);
  if (cholesky.info() != Eigen::Success || !(cholesky.rcond() > kLeastCondition)) return false;
  const Eigen::VectorXd scaled_right = right.cwiseQuotient(length);
  out.z = cholesky.matrixL().solve(scaled_right);
  out.r = Eigen::MatrixXd(cholesky.matrixU()) * length.asDiagonal();
  for (Eigen::Index i = 0; i < m; ++i)
    if (gram(i, i) <= 0.0) out.r.col(i).setZero();
  return true;
}

Reduced reduce_columns(const Eigen::MatrixXd& columns, const Eigen::VectorXd& target) {
  const Eigen::Index m = columns.cols(), rows = std::min(columns.rows(), m);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(columns);
  Reduced out;
  out.r = qr.matrixQR().topRows(rows).triangularView<Eigen::Upper>();
  const Eigen::VectorXd turned = qr.householderQ().adjoint() * target;
  out.z = turned.head(rows);
  return out;
}

// At the solution every coefficient obeys its sign s_j and, with the gradient g = R'(z - R x), the Kuhn-Tucker
// conditions hold: g_j = 0 where x_j moves freely, s_j g_j <= 0 where x_j is held at zero (Lawson & Hanson 1974, ch.
// 23). Each pass solves for the free columns, scaled to length one; a broken sign holds a column, a gradient that
// points the allowed way frees one. 1e-12 and 1e-9 are rounding, relative to the size of z; passes are limited against
// a cycle between two columns that rounding alone tells apart.
Eigen::VectorXd solve_signed(const Reduced& problem, const std::vector<Sign>& signs) {
  constexpr double kSame = 1e-10;
  const Eigen::Index m = problem.r.cols();
  const Eigen::VectorXd length = problem.r.colwise().norm().transpose();
  std::vector<bool> held(static_cast<std::size_t>(m));
  for (Eigen::Index i = 0; i < m; ++i) held[i] = length[i] == 0.0;
  Eigen::VectorXd solution = Eigen::VectorXd::Zero(m);
  const double size = problem.z.norm();
  for (Eigen::Index pass = 0; pass < 3 * m + 3; ++pass) {
    std::vector<Eigen::Index> in;
    for (Eigen::Index i = 0; i < m; ++i)
      if (!held[i]) in.push_back(i);
    const auto k = static_cast<Eigen::Index>(in.size());
    Eigen::MatrixXd columns(problem.r.rows(), k);
    for (Eigen::Index i = 0; i < k; ++i) columns.col(i) = problem.r.col(in[i]) / length[in[i]];
    Eigen::VectorXd x = Eigen::VectorXd::Zero(k);
    if (k > 0) {
      Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver;
      solver.setThreshold(kSame);
      solver.compute(columns);
      x = solver.solve(problem.z);
    }
    solution.setZero();
    Eigen::Index worst = -1;
    double worst_value = -1e-12;
    for (Eigen::Index i = 0; i < k; ++i) {
      const double wrong = signs[in[i]] == Sign::kNonNegative ? x[i] : signs[in[i]] == Sign::kNonPositive ? -x[i] : 0.0;
      if (wrong < worst_value) {
        worst_value = wrong;
        worst = in[i];
      }
      solution[in[i]] = x[i] / length[in[i]];
    }
    if (worst >= 0) {
      held[worst] = true;
      continue;
    }
    Eigen::Index back = -1;
    double gain = 1e-9 * std::max(size, 1.0);
    const Eigen::VectorXd gradient = problem.r.transpose() * (problem.z - problem.r * solution);
    for (Eigen::Index i = 0; i < m; ++i) {
      if (!held[i] || length[i] == 0.0) continue;
      const double slope = gradient[i] / length[i] * (signs[i] == Sign::kNonPositive ? -1.0 : 1.0);
      if (slope > gain) {
        gain = slope;
        back = i;
      }
    }
    if (back < 0 || pass > 2 * m) break;
    held[back] = false;
  }
  return solution;
}

}  // namespace isorig::identify
