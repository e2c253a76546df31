#pragma once
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"

namespace isorig::identify {

struct NamedValue {
  std::string name;
  double value = 0.0;
  double low = 0.0;  ///< 95 % interval
  double high = 0.0;
  int part = 1;                     ///< of which part, where an effect has several (slips): counted from 1
  const model::Law* law = nullptr;  ///< of that part

  /// The name, and from the second part on its number: "slip_mm", "slip_mm_2".
  [[nodiscard]] std::string key() const { return part == 1 ? name : name + "_" + std::to_string(part); }
};

/// What an interval counts as uncertain.
enum class Spread {
  kNoise,  ///< the curvature of the likelihood under the problem's noise, no less than what is left
  kMoves,  ///< and what the moves or strokes of a recording disagree by (cluster-robust), when that is more
};

/// The numbers of a model that were fitted: free parameters of every part in the order of the file, then coefficients
/// that are not zero. Those of parts that are fixed, and the times of events, are none.
[[nodiscard]] std::vector<FreeNumber> fitted_numbers(const model::ModelSpec& spec);

/// Their covariance: the correlations of the curvature of the likelihood, with the standard errors that `spread` says.
/// `fitted_under`: the noise whose squares the numbers minimise, where it is not the problem's (plain least squares).
[[nodiscard]] Eigen::MatrixXd covariance(const Problem& problem, const model::ModelSpec& spec, Spread spread,
                                         const std::optional<NoiseModel>& fitted_under = {});

/// Variance of a value that depends on the fitted numbers, row by row, to first order: (J C J')_ii. `differences` is
/// what free_parameters.hpp calls so: each column is J times the difference_step of its number. A number that moves
/// no force (the time constant of an arm without stiffness) has a variance without bound and no part in the value: it
/// is left out.
[[nodiscard]] Eigen::VectorXd variance_by_numbers(const model::ModelSpec& spec, const std::vector<FreeNumber>& numbers,
                                                  const Eigen::MatrixXd& covariance,
                                                  const Eigen::MatrixXd& differences);

/// Parameters and coefficients of every part, in the order of the spec, with 95 % intervals. Whitened by the
/// problem's noise, which takes up model error: the intervals grow with the residual. They do not cover an error of
/// the model that is the same in every move: such an error shifts the number without any two moves disagreeing.
[[nodiscard]] std::vector<std::vector<NamedValue>> intervals(const Problem& problem, const model::ModelSpec& spec,
                                                             Spread spread,
                                                             const std::optional<NoiseModel>& fitted_under = {});

}  // namespace isorig::identify
