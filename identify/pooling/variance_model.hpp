#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

namespace isorig::identify::pooling {

/// One number of one recording, with its own standard error.
struct Measurement {
  std::size_t actuator = 0;  ///< 0 ... actuators - 1
  double pressure_psi = 0.0;
  double value = 0.0;
  double standard_error = 0.0;
};

/// Standard deviations, in the unit of the value (`slope`: in that unit per psi).
struct Scales {
  double level = 0.0;       ///< between actuators, at the mean pressure
  double slope = 0.0;       ///< between actuators, of what a psi changes
  double cell = 0.0;        ///< of an actuator at one pressure, about its line
  double repetition = 0.0;  ///< between repetitions, beyond the stated standard errors
};

/// Which of them the measurements can show; the others are zero.
struct Shown {
  bool level = false, slope = false, cell = false, repetition = false;
  bool pressures = false;  ///< at least two, which can be told from the actuators: a common slope exists
};

/// Further variance of what is taken out of the pool for a trial (outliers.hpp); empty: none.
struct Inflation {
  std::vector<double> measurement;  ///< added to the variance of a measurement, in the caller's order
  std::vector<double> level;        ///< of an actuator: added to the variance of its level
  std::vector<double> slope;        ///< likewise of its slope
};

/// With y a measurement, p its pressure, i its actuator, j its cell (actuator and pressure), k its repetition:
///
///     y_ijk = mu + beta (p_j - p_mean) + a_i + b_i (p_j - p_mean) + c_ij + r_ijk + e_ijk
///
/// a, b, c, r normal with the variances of Scales, e with its known standard error (Laird & Ware 1982). Everything
/// that depends on the measurements is summed once for each cell, then once for each actuator: a value of the
/// restricted likelihood costs O(actuators) where only `level` and `slope` change.
class VarianceModel {
 public:
  /// Throws std::invalid_argument without measurements, and for one that is not finite or has no standard error.
  VarianceModel(std::span<const Measurement> measurements, std::size_t actuators);

  /// Of all measurements of a cell: precision, weighted mean, what they scatter about it.
  struct CellSums {
    double precision = 0.0, mean = 0.0, scatter = 0.0, log_variance = 0.0;
  };
  [[nodiscard]] std::vector<CellSums> cells(double repetition_sd, const Inflation& inflation = {}) const;

  /// Of all cells of an actuator, with Z = [1, p - p_mean] and weights W: Z'WZ, Z'Wy, y'Wy, log |V|.
  struct ActuatorSums {
    Eigen::Matrix2d precision = Eigen::Matrix2d::Zero();
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    double squares = 0.0, log_variance = 0.0;
  };
  [[nodiscard]] std::vector<ActuatorSums> actuators(const std::vector<CellSums>& cells, double cell_sd) const;

  /// Generalized least squares of mu and beta at given scales.
  struct Solution {
    double log_likelihood = 0.0;         ///< restricted, up to a constant of the layout
    double log_evidence_slope = 0.0;     ///< with beta normal about zero with the given prior sd
    double log_evidence_constant = 0.0;  ///< with beta zero
    Eigen::Vector2d mean{0.0, 0.0};      ///< mu, beta
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  };
  [[nodiscard]] Solution solve(const std::vector<ActuatorSums>& sums, double level_sd, double slope_sd,
                               double slope_prior_sd, const Inflation& inflation = {}) const;

  /// An actuator's own level and slope given mu and beta as solved for: mean and covariance, theirs included.
  struct Own {
    Eigen::Vector2d mean{0.0, 0.0};
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  };
  [[nodiscard]] static Own own(const ActuatorSums& of, const Solution& solution, double level_sd, double slope_sd);

  [[nodiscard]] const Shown& shown() const noexcept { return shown_; }
  [[nodiscard]] double mean_pressure_psi() const noexcept { return mean_pressure_psi_; }
  /// 0 where there is no common slope.
  [[nodiscard]] double pressure_sd_psi() const noexcept { return pressure_sd_psi_; }
  /// Scatter about one straight line for all, and about one value for all: what priors are scaled by.
  [[nodiscard]] double scatter() const noexcept { return scatter_; }
  [[nodiscard]] double total_scatter() const noexcept { return total_scatter_; }
  [[nodiscard]] std::size_t size() const noexcept { return value_.size(); }
  [[nodiscard]] std::size_t actuator_count() const noexcept { return first_cell_.size() - 1; }
  /// Where measurement i of the caller stands in its cell.
  [[nodiscard]] std::size_t cell_of(std::size_t measurement) const { return cell_of_[measurement]; }
  [[nodiscard]] double pressure_of_cell_psi(std::size_t cell) const { return mean_pressure_psi_ + offset_psi_[cell]; }
  [[nodiscard]] std::size_t cell_count() const noexcept { return offset_psi_.size(); }

 private:
  void measure_scatter(std::span<const Measurement> measurements);

  std::vector<double> value_, variance_;  ///< sorted by cell
  std::vector<std::size_t> original_;     ///< index of the caller's
  std::vector<std::size_t> cell_of_;      ///< of the caller's measurements
  std::vector<std::size_t> first_measurement_, first_cell_;
  std::vector<double> offset_psi_;  ///< of a cell from the mean pressure
  Shown shown_;
  double mean_pressure_psi_ = 0.0, pressure_sd_psi_ = 0.0, scatter_ = 0.0, total_scatter_ = 0.0;
};

}  // namespace isorig::identify::pooling
