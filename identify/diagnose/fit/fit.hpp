#pragma once
#include <Eigen/Dense>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/fit/nonlinear_least_squares.hpp"
#include "identify/diagnose/fit/whiten.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

struct Fit {
  model::ModelSpec spec;
  NoiseModel noise;
  double log_likelihood = 0.0;
  double chi2 = 0.0;  ///< whitened sum of squares
  double sum_log = 0.0;
  std::size_t rows = 0;
  Eigen::VectorXd residual;    ///< whitened, one per bin
  std::vector<bool> at_bound;  ///< per search parameter
  int evaluations = 0;
  Stop stop = Stop::kConverged;  ///< why the search for the parameters ended
};

/// What is searched and what is solved for, and how to evaluate it.
class Problem {
 public:
  Problem(std::span<const Series> series, NoiseModel noise);

  [[nodiscard]] std::span<const Series> series() const noexcept { return series_; }
  [[nodiscard]] const NoiseModel& noise() const noexcept { return noise_; }
  void set_noise(const NoiseModel& noise);

  /// Columns of every coefficient, unwhitened, bins of all series below each other.
  void columns(const model::ModelSpec& spec, RowMatrix& out) const;
  /// Force per bin with the spec's coefficients.
  [[nodiscard]] Eigen::VectorXd predict(const model::ModelSpec& spec) const;
  [[nodiscard]] const Eigen::VectorXd& target() const noexcept { return force_; }

  /// Solves the coefficients for the spec's parameters, signs obeyed. Sets them in `spec`; whitened residual
  /// out.
  double solve(model::ModelSpec& spec, Eigen::VectorXd& residual) const;

  /// Variable projection (Golub & Pereyra 1973). The force is F(t) = sum_j c_j f_j(t; p): coefficients c enter
  /// linearly, parameters p do not. For every p that the search tries, c is the solution of the linear problem, signs
  /// obeyed; so the search walks over p alone, down
  ///
  ///     chi2(p) = min_c | W (F_measured - sum_j c_j f_j(p)) |^2
  ///
  /// with W the whitening filter of the noise (whiten.hpp). Steps by minimise_squares().
  [[nodiscard]] Fit fit(model::ModelSpec spec, int iterations = 25) const;

  /// Noise of the residual of a fit by maximum likelihood (white and coloured).
  [[nodiscard]] NoiseModel estimate_noise(const model::ModelSpec& spec) const;
  /// Log-likelihood of the residual of `spec` under `noise`.
  [[nodiscard]] double log_likelihood(const model::ModelSpec& spec, const NoiseModel& noise) const;

 private:
  std::span<const Series> series_;
  NoiseModel noise_;
  Eigen::VectorXd force_;
  Eigen::VectorXd whitened_force_;
  Whitener whitener_;
  std::size_t rows_ = 0;
};

}  // namespace isorig::identify
