#pragma once
#include <Eigen/Dense>
#include <vector>

#include "model/process.hpp"

namespace isorig::identify {

/// A linear least-squares problem min |A x - b| in its smallest form: A = Q R, z = Q' b. Every sum of squares differs
/// from that of R x - z by a constant.
struct Reduced {
  Eigen::MatrixXd r;
  Eigen::VectorXd z;
};

/// From the normal equations, by Cholesky's factor of A'A with columns scaled to length one; false where that would
/// cost accuracy. A'A has the square of A's condition number: of 16 digits it loses twice as many to near-dependence of
/// the columns as A itself. Below a reciprocal condition of 1e-8 the caller takes reduce_columns().
[[nodiscard]] bool reduce_normal_equations(const Eigen::MatrixXd& gram, const Eigen::VectorXd& right, Reduced& out);

/// From the columns themselves by Householder QR (Golub & Van Loan 2013, 5.3), whose loss is that of A.
[[nodiscard]] Reduced reduce_columns(const Eigen::MatrixXd& columns, const Eigen::VectorXd& target);

/// The coefficients, each with its sign obeyed. An active set: a coefficient that would break its sign is held at
/// zero, worst first, and let in again when the gradient points the allowed way (Lawson & Hanson 1974, ch. 23; few
/// coefficients, so this is exact in practice). Columns that depend on each other to within 1e-10 of their length share
/// their coefficient (the solution of least norm).
[[nodiscard]] Eigen::VectorXd solve_signed(const Reduced& problem, const std::vector<model::Sign>& signs);

}  // namespace isorig::identify
