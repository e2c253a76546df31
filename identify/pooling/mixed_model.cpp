#include "identify/pooling/mixed_model.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "identify/pooling/scale_grid.hpp"

namespace isorig::identify::pooling {
namespace {

/// A mixture of normal distributions, one for each node of the grid.
class Mixture {
 public:
  void add(double weight, double mean, double sd) {
    parts_.push_back({weight, mean, sd});
    total_ += weight;
    first_ += weight * mean;
    second_ += weight * (mean * mean + sd * sd);
  }
  [[nodiscard]] double mean() const { return first_ / total_; }
  [[nodiscard]] double sd() const { return std::sqrt(std::max(second_ / total_ - mean() * mean(), 0.0)); }
  [[nodiscard]] double quantile(double share) const {
    double low = mean() - 60.0 * sd(), high = mean() + 60.0 * sd();
    constexpr int kHalvings = 44;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = 0.5 * (low + high);
      (below(middle) < share ? low : high) = middle;
    }
    return 0.5 * (low + high);
  }
  [[nodiscard]] Estimate estimate() const { return {mean(), sd(), quantile(0.025), quantile(0.975)}; }

 private:
  struct Part {
    double weight, mean, sd;
  };
  [[nodiscard]] double below(double x) const {
    double sum = 0.0;
    for (const Part& p : parts_) sum += p.weight * 0.5 * std::erfc((p.mean - x) / (p.sd * std::numbers::sqrt2));
    return sum / total_;
  }
  std::vector<Part> parts_;
  double total_ = 0.0, first_ = 0.0, second_ = 0.0;
};

/// Of a standard deviation on its axis, by its marginal density.
class Marginal {
 public:
  explicit Marginal(const std::vector<double>& nodes) : nodes_(&nodes), mass_(nodes.size(), 0.0) {}
  void add(double sd, double weight) {
    const auto at = std::ranges::lower_bound(*nodes_, sd);
    mass_[static_cast<std::size_t>(at - nodes_->begin())] += weight;
  }
  [[nodiscard]] Estimate estimate() const {
    double total = 0.0, first = 0.0, second = 0.0;
    for (std::size_t i = 0; i < mass_.size(); ++i) {
      total += mass_[i];
      first += mass_[i] * (*nodes_)[i];
      second += mass_[i] * (*nodes_)[i] * (*nodes_)[i];
    }
    Estimate out{first / total, std::sqrt(std::max(second / total - first / total * first / total, 0.0)), 0.0, 0.0};
    out.low95 = quantile(0.025 * total);
    out.high95 = quantile(0.975 * total);
    return out;
  }

 private:
  /// A node's mass lies evenly to half way to its neighbours.
  [[nodiscard]] double quantile(double sought) const {
    if (nodes_->size() < 2) return nodes_->front();
    double so_far = 0.0;
    for (std::size_t i = 0; i < mass_.size(); ++i) {
      const double from = i == 0 ? (*nodes_)[0] : 0.5 * ((*nodes_)[i - 1] + (*nodes_)[i]);
      const double to = i + 1 == mass_.size() ? (*nodes_)[i] : 0.5 * ((*nodes_)[i] + (*nodes_)[i + 1]);
      if (so_far + mass_[i] >= sought && mass_[i] > 0.0) return from + (to - from) * (sought - so_far) / mass_[i];
      so_far += mass_[i];
    }
    return nodes_->back();
  }
  const std::vector<double>* nodes_;
  std::vector<double> mass_;
};

/// Means and variances of the actuators' own numbers over the nodes.
struct Moments {
  Eigen::Vector2d first = Eigen::Vector2d::Zero(), second = Eigen::Vector2d::Zero();
};

Estimate normal_estimate(double mean, double second) {
  const double sd = std::sqrt(std::max(second - mean * mean, 0.0));
  return {mean, sd, mean - kZ95 * sd, mean + kZ95 * sd};
}

void add_actuators(Pooled& out, const VarianceModel& model, const std::vector<Moments>& moments,
                   std::span<const Measurement> measurements) {
  out.actuators.resize(moments.size());
  for (const Measurement& m : measurements) ++out.actuators[m.actuator].measurements;
  const auto sums = model.actuators(model.cells(out.scales.repetition), out.scales.cell);
  for (std::size_t i = 0; i < moments.size(); ++i) {
    Pooled::Actuator& one = out.actuators[i];
    one.level = normal_estimate(moments[i].first(0), moments[i].second(0));
    if (model.shown().pressures) one.slope = normal_estimate(moments[i].first(1), moments[i].second(1));
    one.unpooled_level = one.unpooled_error = std::numeric_limits<double>::quiet_NaN();
    const Eigen::Matrix2d& a = sums[i].precision;
    if (one.measurements == 0) continue;
    // Its own line where it has two pressures; else its mean, carried to the mean pressure by the common slope.
    if (a.determinant() > 1e-9 * a(0, 0) * a(1, 1) && a(1, 1) > 0.0) {
      const Eigen::Matrix2d c = a.inverse();
      one.unpooled_level = (c * sums[i].moment)(0);
      one.unpooled_error = std::sqrt(c(0, 0));
    } else {
      const double slope = out.slope ? out.slope->value : 0.0;
      one.unpooled_level = (sums[i].moment(0) - slope * a(0, 1)) / a(0, 0);
      one.unpooled_error = std::sqrt(1.0 / a(0, 0));
    }
  }
}

/// ln of the evidence, integrated over the scales on the grid that fits it.
double log_evidence_of_constant(const VarianceModel& model) {
  std::vector<double> parts;
  each_node(model, find_grid(model, false), false,
            [&](const Node& node, const auto&) { parts.push_back(node.log_weight); });
  return log_sum(parts);
}

}  // namespace

double log_prior(const VarianceModel& model, const Scales& scales) {
  const double unit = 3.0 * model.scatter();
  const double slope_unit = model.pressure_sd_psi() > 0.0 ? unit / model.pressure_sd_psi() : unit;
  const auto half_normal = [](double sd, double scale) { return -0.5 * (sd / scale) * (sd / scale); };
  return half_normal(scales.level, unit) + half_normal(scales.slope, slope_unit) + half_normal(scales.cell, unit) +
         half_normal(scales.repetition, unit);
}

Pooled pool_quantity(std::span<const Measurement> measurements, std::size_t actuators) {
  const VarianceModel model(measurements, actuators);
  const ScaleGrid grid = find_grid(model, true);
  std::vector<double> log_weights, log_slope;
  each_node(model, grid, true, [&](const Node& node, const auto&) {
    log_weights.push_back(node.log_weight);
    log_slope.push_back(node.log_weight - node.solution.log_likelihood + node.solution.log_evidence_slope);
  });
  const double all = log_sum(log_weights);

  constexpr double kNothing = 1e-7;  // of the posterior, left out for speed
  Mixture level, slope;
  std::array<Marginal, kAxes> marginal{Marginal(grid[0].sd), Marginal(grid[1].sd), Marginal(grid[2].sd),
                                       Marginal(grid[3].sd)};
  std::vector<Moments> moments(actuators);
  double kept = 0.0;
  each_node(model, grid, true, [&](const Node& node, const auto& sums) {
    const double weight = std::exp(node.log_weight - all);
    if (weight < kNothing) return;
    kept += weight;
    const auto& s = node.solution;
    level.add(weight, s.mean(0), std::sqrt(s.covariance(0, 0)));
    if (model.shown().pressures) slope.add(weight, s.mean(1), std::sqrt(s.covariance(1, 1)));
    marginal[kRepetition].add(node.scales.repetition, weight);
    marginal[kCell].add(node.scales.cell, weight);
    marginal[kSlope].add(node.scales.slope, weight);
    marginal[kLevel].add(node.scales.level, weight);
    for (std::size_t i = 0; i < actuators; ++i) {
      const auto own = VarianceModel::own(sums[i], s, node.scales.level, node.scales.slope);
      moments[i].first += weight * own.mean;
      moments[i].second += weight * (own.mean.cwiseAbs2() + own.covariance.diagonal());
    }
  });
  for (Moments& m : moments) {
    m.first /= kept;
    m.second /= kept;
  }
  Pooled out;
  out.mean_pressure_psi = model.mean_pressure_psi();
  out.level = level.estimate();
  if (model.shown().pressures) {
    out.slope = slope.estimate();
    out.log_evidence_of_slope = log_sum(log_slope) - log_evidence_of_constant(model);
  }
  out.level_sd = marginal[kLevel].estimate();
  out.slope_sd = marginal[kSlope].estimate();
  out.cell_sd = marginal[kCell].estimate();
  out.repetition_sd = marginal[kRepetition].estimate();
  out.scales = {out.level_sd.value, out.slope_sd.value, out.cell_sd.value, out.repetition_sd.value};
  add_actuators(out, model, moments, measurements);
  return out;
}

}  // namespace isorig::identify::pooling
