#pragma once
#include <Eigen/Dense>
#include <functional>
#include <vector>

#include "model/composed.hpp"

namespace isorig::identify {

/// A number of a model that a fit may move: a parameter that is searched, or a coefficient that is solved for.
struct FreeNumber {
  std::size_t part = 0;
  std::size_t index = 0;  ///< into the part's parameters or coefficients
  bool coefficient = false;

  bool operator==(const FreeNumber&) const = default;
};

/// What a gradient leads to: neither what is given nor the time of an event, which is found by scanning.
[[nodiscard]] std::vector<FreeNumber> free_parameters(const model::ModelSpec& spec);
/// Of parts that are not fixed.
[[nodiscard]] std::vector<FreeNumber> free_coefficients(const model::ModelSpec& spec);

/// How many numbers an explanation has bent to the data: what the Bayesian information criterion counts. A
/// coefficient of zero counts nothing, nor does the law that hangs on it. The time of an event counts as two: it was
/// chosen from all readings (modified BIC, Zhang & Siegmund 2007).
[[nodiscard]] std::size_t counted_numbers(const model::ModelSpec& spec);

[[nodiscard]] double& value_of(model::ModelSpec& spec, const FreeNumber& number);
[[nodiscard]] double value_of(const model::ModelSpec& spec, const FreeNumber& number);

/// Relative step of every finite difference. A forward difference of step h errs by h/2 of the curvature and by 2 e/h
/// of the simulation's own error e (Gill, Murray & Wright 1981, 8.6). Most laws are exact (e = 1e-16), but
/// nonlinear_viscosity steps with a controlled error, e = 1e-6 of the peak, which asks for h = 2 sqrt(e) = 2e-3 where
/// the exact ones want less. At 1e-3 both errors stay below 0.5 % of the derivative: a search needs 10 %, a 95 %
/// interval 5 %. free_parameters_test measures it for every law.
inline constexpr double kDifferenceStep = 1e-3;

/// The step of one number, in its own unit: kDifferenceStep of its size. A number near zero has the size of a
/// hundredth of its range (of a unit, where the range is wider). Negative where the upper bound is nearer than that.
[[nodiscard]] double difference_step(const model::ModelSpec& spec, const FreeNumber& number);

/// One column a number: what `value` (of the spec, `at` where it stands) changes by when the number moves by its
/// difference_step. Not divided by the step: all columns are of the size of the value.
[[nodiscard]] Eigen::MatrixXd differences(const model::ModelSpec& spec, const std::vector<FreeNumber>& numbers,
                                          const Eigen::VectorXd& at,
                                          const std::function<Eigen::VectorXd(const model::ModelSpec&)>& value);

/// The coordinate in which a parameter is searched: its logarithm, where it is positive over decades.
[[nodiscard]] double to_search(const model::Parameter& parameter, double value);
/// Within the bounds.
[[nodiscard]] double from_search(const model::Parameter& parameter, double coordinate);
/// Size of the parameter in that coordinate.
[[nodiscard]] double search_scale(const model::Parameter& parameter);

[[nodiscard]] const model::Parameter& parameter_of(const model::ModelSpec& spec, const FreeNumber& number);
/// At an end of its range, to rounding.
[[nodiscard]] bool at_bound(const model::Parameter& parameter, double value);

}  // namespace isorig::identify
