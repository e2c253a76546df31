#pragma once
#include <Eigen/Dense>
#include <span>
#include <vector>

#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// Force noise: white per reading, and an Ornstein-Uhlenbeck part that stands for coloured noise and for what
/// the model still lacks (a Gaussian process in time, amplitude inferred per hypothesis).
struct NoiseModel {
  double white_N = 0.01;    ///< rms per reading
  double coloured_N = 0.0;  ///< stationary rms
  double correlation_s = 1.0;

  bool operator==(const NoiseModel&) const = default;
};

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Whitening filter of a noise: the innovations of its Kalman filter, scaled to variance one (Kailath 1968). With
/// white w per reading, coloured c with correlation time T, n_k readings in bin k, dt_k = noise_dt_s(k) and
/// d_k = exp(-dt_k / T)
///
///     P <- d_k^2 P + c^2 (1 - d_k^2)      variance of the coloured state before bin k
///     S  = P + w^2 / n_k                  of the innovation
///     g  = P / S                          gain
///     e  = y_k - d_k x                    innovation; white_k = e / sqrt(S)
///     x <- d_k x + g e,  P <- (1 - g) P
///
/// The log-likelihood is -1/2 sum (white_k^2 + ln S). Gains do not depend on what is filtered and are computed once.
/// Bins without readings become zero rows.
class Whitener {
 public:
  Whitener() = default;
  Whitener(std::span<const Series> series, const NoiseModel& noise);

  /// In place, column by column alike; at most 48 columns.
  void apply(RowMatrix& columns) const;
  /// Sum of log innovation variances.
  [[nodiscard]] double sum_log() const noexcept { return sum_log_; }

 private:
  std::vector<double> decay_, gain_, scale_;
  bool coloured_ = false;
  double sum_log_ = 0.0;
};

/// Whitens in place; returns the sum of log innovation variances.
double whiten(std::span<const Series> series, const NoiseModel& noise, RowMatrix& columns);

/// Log-likelihood of one residual under many noises, without whitening it.
class NoiseScore {
 public:
  NoiseScore(std::span<const Series> series, std::span<const double> residual_N);
  [[nodiscard]] double operator()(const NoiseModel& noise);
  /// rms per reading.
  [[nodiscard]] double rms_N() const;

 private:
  struct Row {
    double dt_s;  ///< negative: the first of its series
    double count;
    double residual_N;
  };
  std::vector<Row> rows_;
  std::vector<double> decay_;
  double decay_for_s_ = -1.0;
};

}  // namespace isorig::identify
