#pragma once
#include <Eigen/Dense>
#include <functional>
#include <string_view>

namespace isorig::identify {

/// Why a search stopped.
enum class Stop {
  kConverged,       ///< no step gains anything that counts
  kAtBounds,        ///< converged, with a number held at a bound that it would otherwise cross
  kNoProgress,      ///< the slopes promise a gain that no step finds: a kink, a jump, a number that does nothing
  kIterationLimit,  ///< it was still gaining
};
[[nodiscard]] std::string_view name_of(Stop stop) noexcept;

/// What is minimised: the sum of squares of `residual` over the box lower <= u <= upper.
struct LeastSquaresProblem {
  std::function<void(const Eigen::VectorXd& u, Eigen::VectorXd& residual)> residual;
  std::function<Eigen::VectorXd(const Eigen::VectorXd& u)> difference_steps;  ///< of each coordinate, signed
  std::function<void()> accepted = [] {};  ///< the search now stands where the residual was asked for last
  Eigen::VectorXd lower, upper;
  Eigen::VectorXd longest_step;
};

struct LeastSquaresResult {
  Eigen::VectorXd u;
  Eigen::VectorXd residual;
  double squares = 0.0;
  Stop stop = Stop::kConverged;
  int evaluations = 0;
};

/// Levenberg and Marquardt's search (Marquardt 1963; More 1978). With the Jacobian J by forward differences, r the
/// residual and D the lengths of J's columns, a step s solves
///
///     min | J s + r |^2 + damping | D s |^2
///
/// as the least-squares problem of J stacked on sqrt(damping) D: J = Q R once, then QR of the small stack R over
/// sqrt(damping) D, again for every damping that is tried. The normal equations J'J s = -J'r would square the condition
/// number: along a valley, where two numbers nearly replace each other, the direction down the valley would be lost in
/// rounding. Coordinates at a bound whose gradient points out are held there while the others move.
///
/// Squares are in units of the noise; a gain below 1e-3 counts as none. The search stopped for want of progress if the
/// slopes still promise 0.05 of the mean square or more, which is a number a quarter of its standard error from its
/// optimum.
[[nodiscard]] LeastSquaresResult minimise_squares(const LeastSquaresProblem& problem, Eigen::VectorXd u,
                                                  int iterations);

}  // namespace isorig::identify
