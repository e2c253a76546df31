#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

/// The study's own least squares for the nominal models slse1 and slse2: F = k x + sum_i k_i z_i(tau_i) + F0.
/// It sizes what is concealed and is the ground that the baselines stand on; the tool's own refit is not
/// used.
namespace isorig::proof {

/// Output of a linear Maxwell arm of unit stiffness on positions joined by straight lines:
/// z' = v - z / tau, exact for each line.
[[nodiscard]] Eigen::VectorXd maxwell_column(std::span<const double> t_s, std::span<const double> position_mm,
                                             double time_constant_s);

struct NominalFit {
  std::vector<double> time_constants_s;
  /// Of position, each arm, and one, in this order.
  Eigen::VectorXd coefficients;
  Eigen::VectorXd residual_N;  ///< force minus model
  double rmse_N = 0.0;
};

[[nodiscard]] NominalFit fit_nominal(std::span<const double> t_s, std::span<const double> position_mm,
                                     std::span<const double> force_N, int arms);

/// The same optimum found closer: Gauss-Newton steps in the logarithms of all time constants at once (variable
/// projection; Kaufman 1975), each halved until it gains. For forces whose noise is far below what the coordinate-wise
/// search above leaves of two arms (some thousandths of the force).
[[nodiscard]] NominalFit refined(NominalFit fit, std::span<const double> t_s, std::span<const double> position_mm,
                                 std::span<const double> force_N);

[[nodiscard]] Eigen::MatrixXd nominal_columns(std::span<const double> t_s, std::span<const double> position_mm,
                                              std::span<const double> time_constants_s);

/// Rows recorded densely (neighbours nearer than 50 ms): the ramps.
[[nodiscard]] std::vector<bool> dense_rows(std::span<const double> t_s);

/// How much of the force stays unexplained: the 99th percentile of |residual| over the densely recorded rows
/// or over the others, whichever is larger.
[[nodiscard]] double residual_size_N(const NominalFit& fit, const std::vector<bool>& dense);

}  // namespace isorig::proof
