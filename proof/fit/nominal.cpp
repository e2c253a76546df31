#include "proof/fit/nominal.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "base/quantile.hpp"

namespace isorig::proof {

Eigen::VectorXd maxwell_column(std::span<const double> t_s, std::span<const double> position_mm,
                               double time_constant_s) {
  Eigen::VectorXd column(static_cast<Eigen::Index>(t_s.size()));
  double stretch_mm = 0.0;
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    if (i > 0) {
      const double ratio = (t_s[i] - t_s[i - 1]) / time_constant_s;
      const double decay = std::exp(-ratio);
      stretch_mm = stretch_mm * decay + (position_mm[i] - position_mm[i - 1]) * (1.0 - decay) / ratio;
    }
    column[static_cast<Eigen::Index>(i)] = stretch_mm;
  }
  return column;
}

Eigen::MatrixXd nominal_columns(std::span<const double> t_s, std::span<const double> position_mm,
                                std::span<const double> time_constants_s) {
  const auto rows = static_cast<Eigen::Index>(t_s.size());
  const auto arms = static_cast<Eigen::Index>(time_constants_s.size());
  Eigen::MatrixXd columns(rows, arms + 2);
  columns.col(0) = Eigen::Map<const Eigen::VectorXd>(position_mm.data(), rows);
  for (Eigen::Index i = 0; i < arms; ++i)
    columns.col(i + 1) = maxwell_column(t_s, position_mm, time_constants_s[static_cast<std::size_t>(i)]);
  columns.col(arms + 1).setOnes();
  return columns;
}

namespace {

struct Solution {
  Eigen::VectorXd coefficients;
  double sum_of_squares = 0.0;
};

Solution solve(const Eigen::MatrixXd& gram, const Eigen::VectorXd& moment, double power) {
  // Scaled to a unit diagonal; the ridge only guards against two equal arms.
  const Eigen::VectorXd scale = gram.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = scale.asDiagonal() * gram * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  const Eigen::VectorXd x = scaled.ldlt().solve(scale.asDiagonal() * moment);
  Solution solution{scale.asDiagonal() * x, 0.0};
  solution.sum_of_squares =
      power - 2.0 * solution.coefficients.dot(moment) + solution.coefficients.dot(gram * solution.coefficients);
  return solution;
}

}  // namespace

NominalFit fit_nominal(std::span<const double> t_s, std::span<const double> position_mm,
                       std::span<const double> force_N, int arms) {
  const auto rows = static_cast<Eigen::Index>(t_s.size());
  const Eigen::Map<const Eigen::VectorXd> measured(force_N.data(), rows);
  const double mean_N = measured.mean();
  const Eigen::VectorXd force = measured.array() - mean_N;  // keeps the sums of squares well conditioned

  // Every time constant of a coarse grid at once, then all choices from one Gram matrix.
  constexpr int kGrid = 20;
  std::vector<double> grid;
  for (int i = 0; i < kGrid; ++i) grid.push_back(0.02 * std::pow(60.0 / 0.02, i / (kGrid - 1.0)));
  const Eigen::MatrixXd all = nominal_columns(t_s, position_mm, grid);
  const Eigen::MatrixXd gram = all.transpose() * all;
  const Eigen::VectorXd moment = all.transpose() * force;
  const double power = force.squaredNorm();
  std::vector<int> best;
  double least = INFINITY;
  const auto try_arms = [&](const std::vector<int>& chosen) {
    std::vector<int> index{0};
    for (const int i : chosen) index.push_back(i + 1);
    index.push_back(kGrid + 1);
    const double sum = solve(gram(index, index), moment(index), power).sum_of_squares;
    if (sum < least) {
      least = sum;
      best = chosen;
    }
  };
  for (int i = 0; i < kGrid; ++i) {
    if (arms == 1) try_arms({i});
    for (int j = i + 2; arms == 2 && j < kGrid; ++j) try_arms({i, j});
  }

  NominalFit fit;
  for (const int i : best) fit.time_constants_s.push_back(grid[static_cast<std::size_t>(i)]);
  const auto sum_at = [&](const std::vector<double>& times) {
    const Eigen::MatrixXd columns = nominal_columns(t_s, position_mm, times);
    return solve(columns.transpose() * columns, columns.transpose() * force, power).sum_of_squares;
  };
  // One time constant after the other by a shrinking step: few rounds are enough from so near.
  double step = 0.5 * std::log(grid[1] / grid[0]);
  for (int round = 0; round < 14; ++round, step *= 0.6) {
    for (double& time_s : fit.time_constants_s) {
      for (const double factor : {std::exp(step), std::exp(-step)}) {
        const double kept = time_s;
        time_s = kept * factor;
        const double sum = sum_at(fit.time_constants_s);
        if (sum < least) {
          least = sum;
          break;
        }
        time_s = kept;
      }
    }
  }
  const Eigen::MatrixXd columns = nominal_columns(t_s, position_mm, fit.time_constants_s);
  fit.coefficients = solve(columns.transpose() * columns, columns.transpose() * force, power).coefficients;
  fit.residual_N = force - columns * fit.coefficients;
  fit.coefficients[fit.coefficients.size() - 1] += mean_N;
  fit.rmse_N = std::sqrt(fit.residual_N.squaredNorm() / static_cast<double>(rows));
  return fit;
}

NominalFit refined(NominalFit fit, std::span<const double> t_s, std::span<const double> position_mm,
                   std::span<const double> force_N) {
  const auto rows = static_cast<Eigen::Index>(t_s.size());
  const auto arms = static_cast<Eigen::Index>(fit.time_constants_s.size());
  const Eigen::Map<const Eigen::VectorXd> measured(force_N.data(), rows);
  const auto fitted_at = [&](const std::vector<double>& times) {
    NominalFit at;
    at.time_constants_s = times;
    const Eigen::MatrixXd columns = nominal_columns(t_s, position_mm, times);
    const double mean_N = measured.mean();
    const Eigen::VectorXd force = measured.array() - mean_N;
    at.coefficients = columns.colPivHouseholderQr().solve(force);
    at.residual_N = force - columns * at.coefficients;
    at.coefficients[arms + 1] += mean_N;
    at.rmse_N = std::sqrt(at.residual_N.squaredNorm() / static_cast<double>(rows));
    return at;
  };
  fit = fitted_at(fit.time_constants_s);
  constexpr int kRounds = 8;
  constexpr double kDifference = 1e-3, kConverged = 1e-5, kLongest = 0.7;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::MatrixXd columns(rows, 2 * arms + 2);
    columns.leftCols(arms + 2) = nominal_columns(t_s, position_mm, fit.time_constants_s);
    for (Eigen::Index i = 0; i < arms; ++i) {
      const double time_s = fit.time_constants_s[static_cast<std::size_t>(i)];
      columns.col(arms + 2 + i) = (maxwell_column(t_s, position_mm, time_s * std::exp(kDifference)) -
                                   maxwell_column(t_s, position_mm, time_s * std::exp(-kDifference))) *
                                  (fit.coefficients[i + 1] / (2.0 * kDifference));
    }
    const Eigen::VectorXd step = columns.colPivHouseholderQr().solve(fit.residual_N).tail(arms);
    if (!step.allFinite()) break;
    const double largest = step.cwiseAbs().maxCoeff();
    bool gained = false;
    for (double part = std::fmin(1.0, kLongest / largest); part > 0.05 && !gained; part *= 0.5) {
      std::vector<double> times = fit.time_constants_s;
      for (Eigen::Index i = 0; i < arms; ++i) times[static_cast<std::size_t>(i)] *= std::exp(part * step[i]);
      if (std::ranges::any_of(times, [](double time_s) { return time_s < 1e-3 || time_s > 1e4; })) continue;
      NominalFit next = fitted_at(times);
      gained = next.rmse_N < fit.rmse_N;
      if (gained) fit = std::move(next);
    }
    if (!gained || largest < kConverged) break;
  }
  return fit;
}

std::vector<bool> dense_rows(std::span<const double> t_s) {
  std::vector<bool> dense(t_s.size(), false);
  for (std::size_t i = 1; i < t_s.size(); ++i)
    if (t_s[i] - t_s[i - 1] < 0.05) dense[i] = dense[i - 1] = true;
  return dense;
}

double residual_size_N(const NominalFit& fit, const std::vector<bool>& dense) {
  double size_N = 0.0;
  for (const bool which : {true, false}) {
    std::vector<double> magnitude;
    for (std::size_t i = 0; i < dense.size(); ++i)
      if (dense[i] == which) magnitude.push_back(std::abs(fit.residual_N[static_cast<Eigen::Index>(i)]));
    if (!magnitude.empty()) size_N = std::fmax(size_N, base::quantile_in_place(magnitude, 0.99));
  }
  return size_N;
}

}  // namespace isorig::proof
