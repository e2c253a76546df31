#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "identify/fv/fv_fit.hpp"
#include "model/force_velocity.hpp"

/// Within this room alone: fit_control and fit_sheath (fv_fit.hpp) are what others call.
namespace isorig::identify {

struct LogBounds {
  double low, high;
};

/// Least squares of an element's numbers, as logarithms, to a curve's points. A point's residual as a function of
/// log kappa, log gamma and, with a control held, log beta (eqs. 4 and 8):
///
///     1 + sgn(v) deps / eps0 (1 + height) - F / F0,   height = kappa phi(u),   u = gamma deps / |v|
///     with a control c:   height = (kappa_c phi(u_c) + beta kappa phi(u)) / (1 + beta)
class FvProblem {
 public:
  FvProblem(std::span<const FvPoint> points, std::optional<model::FvElement> control);

  [[nodiscard]] std::size_t size() const { return control_ ? 3 : 2; }
  [[nodiscard]] const LogBounds& bounds(std::size_t k) const { return bounds_[k]; }

  /// Refines `logs` within the bounds; parameter `held` stays. Returns the sum of squares.
  double solve(std::array<double, 3>& logs, int held = -1) const;

  [[nodiscard]] double sum_of_squares(const std::array<double, 3>& logs) const;
  [[nodiscard]] std::vector<model::FvElement> elements(const std::array<double, 3>& logs) const;

 private:
  /// What of a point does not change with the parameters.
  struct Row {
    double duration = 0.0;  ///< deps / |v| [s]
    double jump = 0.0;      ///< sgn(v) deps / eps0
    double excess = 0.0;    ///< F / F0 - 1 - jump: what jump * height has to make
    double held = 0.0;      ///< kappa_c phi(u_c) of the control, 0 without one
  };
  struct Squares;
  [[nodiscard]] Squares squares(const std::array<double, 3>& logs) const;
  [[nodiscard]] std::optional<Eigen::Vector3d> step_within(const Squares& now, const std::array<double, 3>& logs,
                                                           int held, double damping) const;

  std::vector<Row> rows_;
  std::optional<model::FvElement> control_;
  std::array<LogBounds, 3> bounds_{};
};

}  // namespace isorig::identify
