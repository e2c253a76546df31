#pragma once
#include <Eigen/Dense>

namespace isorig::identify {

/// Orthonormal basis of what the columns span, by Householder QR with pivoting (Golub & Van Loan 2013, 5.4) of columns
/// scaled to one length; a column that depends on others to within 1e-7 of its length adds none.
[[nodiscard]] inline Eigen::MatrixXd orthonormal_basis(Eigen::MatrixXd columns) {
  constexpr double kDependent = 1e-7;
  for (Eigen::Index c = 0; c < columns.cols(); ++c)
    if (const double length = columns.col(c).norm(); length > 0.0) columns.col(c) /= length;
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
  qr.setThreshold(kDependent);
  qr.compute(columns);
  return qr.householderQ() * Eigen::MatrixXd::Identity(columns.rows(), qr.rank());
}

}  // namespace isorig::identify
