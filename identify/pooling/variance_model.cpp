#include "identify/pooling/variance_model.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>

#include "base/formatted.hpp"

namespace isorig::identify::pooling {
namespace {

void check(const Measurement& m, std::size_t actuators, std::size_t at) {
  if (m.actuator >= actuators)
    throw std::invalid_argument(
        base::formatted("measurement %zu is of actuator %zu of %zu", at, m.actuator, actuators));
  if (!std::isfinite(m.value) || !std::isfinite(m.pressure_psi))
    throw std::invalid_argument(base::formatted("measurement %zu is not finite", at));
  if (!std::isfinite(m.standard_error) || m.standard_error <= 0.0)
    throw std::invalid_argument(base::formatted("measurement %zu has no standard error above zero", at));
}

/// (T^-1 + A)^-1 = T (1 + A T)^-1, which holds for a T with zeros as well.
struct Shrinkage {
  Eigen::Matrix2d m, left;  ///< that, and (1 + A T)^-1
  double log_determinant = 0.0;

  Shrinkage(const Eigen::Matrix2d& a, double level_variance, double slope_variance) {
    Eigen::Matrix2d t;
    t << level_variance, 0.0, 0.0, slope_variance;
    const Eigen::Matrix2d b = Eigen::Matrix2d::Identity() + a * t;
    left = b.inverse();
    m = t * left;
    log_determinant = std::log(b.determinant());
  }
};

/// Whether what a psi changes can be told from what the actuators differ by: by one that was measured at two pressures,
/// or by enough of them that their scatter about a line, two to spare, says how much they differ. Two actuators at a
/// pressure each lie on a line whatever they are.
bool tell_pressure_from_actuator(std::span<const Measurement> measurements) {
  constexpr std::size_t kToSpare = 2;
  std::map<std::size_t, std::set<double>> of_actuator;
  std::set<double> pressures;
  for (const Measurement& m : measurements) {
    of_actuator[m.actuator].insert(m.pressure_psi);
    pressures.insert(m.pressure_psi);
  }
  return of_actuator.size() >= pressures.size() + kToSpare ||
         std::ranges::any_of(of_actuator, [](const auto& of) { return of.second.size() > 1; });
}

}  // namespace

VarianceModel::VarianceModel(std::span<const Measurement> measurements, std::size_t actuators) {
  if (measurements.empty()) throw std::invalid_argument("there is no measurement to pool");
  for (std::size_t i = 0; i < measurements.size(); ++i) check(measurements[i], actuators, i);
  original_.resize(measurements.size());
  std::iota(original_.begin(), original_.end(), std::size_t{0});
  std::ranges::stable_sort(
      original_, {}, [&](std::size_t i) { return std::pair(measurements[i].actuator, measurements[i].pressure_psi); });
  measure_scatter(measurements);

  cell_of_.resize(measurements.size());
  first_cell_.assign(actuators + 1, 0);
  std::size_t actuator = 0, present = 0, several_pressures = 0, repeated = 0;
  for (std::size_t k = 0; k < original_.size(); ++k) {
    const Measurement& m = measurements[original_[k]];
    const bool new_actuator = k == 0 || m.actuator != measurements[original_[k - 1]].actuator;
    if (new_actuator) ++present;
    if (new_actuator || m.pressure_psi != measurements[original_[k - 1]].pressure_psi) {
      while (actuator < m.actuator) first_cell_[++actuator] = offset_psi_.size();
      first_measurement_.push_back(k);
      offset_psi_.push_back(m.pressure_psi - mean_pressure_psi_);
    } else {
      ++repeated;
    }
    cell_of_[original_[k]] = offset_psi_.size() - 1;
    value_.push_back(m.value);
    variance_.push_back(m.standard_error * m.standard_error);
  }
  while (actuator < actuators) first_cell_[++actuator] = offset_psi_.size();
  first_measurement_.push_back(value_.size());
  for (std::size_t i = 0; i < actuators; ++i)
    if (first_cell_[i + 1] - first_cell_[i] > 1) ++several_pressures;
  shown_.pressures = pressure_sd_psi_ > 0.0;
  shown_.level = present > 1;
  shown_.slope = present > 1 && several_pressures > 1;
  // Without repetitions what a cell deviates by and what its only recording does are the same thing.
  shown_.cell = repeated > 0 && offset_psi_.size() > present;
  shown_.repetition = repeated > 0 || offset_psi_.size() > present + (shown_.pressures ? 1 : 0);
}

void VarianceModel::measure_scatter(std::span<const Measurement> measurements) {
  const auto n = static_cast<double>(measurements.size());
  double y = 0.0, least_error = INFINITY;
  for (const Measurement& m : measurements) {
    mean_pressure_psi_ += m.pressure_psi / n;
    y += m.value / n;
    least_error = std::min(least_error, m.standard_error);
  }
  double pp = 0.0, py = 0.0, yy = 0.0;
  for (const Measurement& m : measurements) {
    const double d = m.pressure_psi - mean_pressure_psi_;
    pp += d * d;
    py += d * (m.value - y);
    yy += (m.value - y) * (m.value - y);
  }
  pressure_sd_psi_ = std::sqrt(pp / n);
  if (pressure_sd_psi_ < 1e-9 * std::max(1.0, std::abs(mean_pressure_psi_)) ||
      !tell_pressure_from_actuator(measurements))
    pressure_sd_psi_ = 0.0;
  const double left = pressure_sd_psi_ > 0.0 ? std::max(yy - py * py / pp, 0.0) : yy;
  total_scatter_ = std::max(std::sqrt(yy / std::max(1.0, n - 1.0)), least_error);
  scatter_ = std::max(std::sqrt(left / std::max(1.0, n - (pressure_sd_psi_ > 0.0 ? 2.0 : 1.0))), least_error);
}

std::vector<VarianceModel::CellSums> VarianceModel::cells(double repetition_sd, const Inflation& inflation) const {
  std::vector<CellSums> out(cell_count());
  const double common = repetition_sd * repetition_sd;
  for (std::size_t c = 0; c < out.size(); ++c) {
    CellSums& sums = out[c];
    for (std::size_t k = first_measurement_[c]; k < first_measurement_[c + 1]; ++k) {
      double variance = variance_[k] + common;
      if (!inflation.measurement.empty()) variance += inflation.measurement[original_[k]];
      const double weight = 1.0 / variance, total = sums.precision + weight, step = value_[k] - sums.mean;
      // West 1979: the scatter without the cancellation of sums of squares.
      sums.scatter += weight * sums.precision / total * step * step;
      sums.mean += weight / total * step;
      sums.precision = total;
      sums.log_variance += std::log(variance);
    }
  }
  return out;
}

std::vector<VarianceModel::ActuatorSums> VarianceModel::actuators(const std::vector<CellSums>& cells,
                                                                  double cell_sd) const {
  std::vector<ActuatorSums> out(actuator_count());
  const double variance = cell_sd * cell_sd;
  for (std::size_t i = 0; i < out.size(); ++i) {
    ActuatorSums& sums = out[i];
    for (std::size_t c = first_cell_[i]; c < first_cell_[i + 1]; ++c) {
      const double inflated = 1.0 + variance * cells[c].precision, weight = cells[c].precision / inflated;
      const Eigen::Vector2d z(1.0, offset_psi_[c]);
      sums.precision += weight * z * z.transpose();
      sums.moment += weight * cells[c].mean * z;
      sums.squares += weight * cells[c].mean * cells[c].mean + cells[c].scatter;
      sums.log_variance += cells[c].log_variance + std::log(inflated);
    }
  }
  return out;
}

VarianceModel::Solution VarianceModel::solve(const std::vector<ActuatorSums>& sums, double level_sd, double slope_sd,
                                             double slope_prior_sd, const Inflation& inflation) const {
  Eigen::Matrix2d precision = Eigen::Matrix2d::Zero();
  Eigen::Vector2d moment = Eigen::Vector2d::Zero();
  double squares = 0.0, log_variance = 0.0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const ActuatorSums& of = sums[i];
    const Shrinkage s(of.precision, level_sd * level_sd + (inflation.level.empty() ? 0.0 : inflation.level[i]),
                      slope_sd * slope_sd + (inflation.slope.empty() ? 0.0 : inflation.slope[i]));
    precision += s.left * of.precision;
    moment += s.left * of.moment;
    squares += of.squares - of.moment.dot(s.m * of.moment);
    log_variance += of.log_variance + s.log_determinant;
  }
  Solution out;
  const double level_precision = precision(0, 0), alone = moment(0) / level_precision;
  const double constant = -0.5 * (log_variance + squares - alone * moment(0) + std::log(level_precision));
  out.log_evidence_constant = out.log_evidence_slope = constant;
  if (!shown_.pressures) {
    out.mean(0) = alone;
    out.covariance(0, 0) = 1.0 / level_precision;
    out.log_likelihood = constant;
    return out;
  }
  const auto with = [&](const Eigen::Matrix2d& p) {
    return -0.5 * (log_variance + squares - moment.dot(p.inverse() * moment) + std::log(p.determinant()));
  };
  out.covariance = precision.inverse();
  out.mean = out.covariance * moment;
  out.log_likelihood = with(precision);
  Eigen::Matrix2d informed = precision;
  informed(1, 1) += 1.0 / (slope_prior_sd * slope_prior_sd);
  out.log_evidence_slope = with(informed) - std::log(slope_prior_sd);
  return out;
}

VarianceModel::Own VarianceModel::own(const ActuatorSums& of, const Solution& solution, double level_sd,
                                      double slope_sd) {
  const Shrinkage s(of.precision, level_sd * level_sd, slope_sd * slope_sd);
  const Eigen::Matrix2d rest = Eigen::Matrix2d::Identity() - s.m * of.precision;
  return {rest * solution.mean + s.m * of.moment, s.m + rest * solution.covariance * rest.transpose()};
}

}  // namespace isorig::identify::pooling
