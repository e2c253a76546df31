#include "identify/pooling/outliers.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "base/quantile.hpp"
#include "identify/pooling/scale_grid.hpp"

namespace isorig::identify::pooling {
namespace {

constexpr double kSpreads = 5.0;         // how far off an outlier is taken to be, in spreads of the others, at least
constexpr std::size_t kCandidates = 24;  // the furthest, by robust measures; nothing nearer can stand out
constexpr std::size_t kPairsAmong = 6;

using Set = std::set<std::size_t>;

/// Sets of outliers and ln of their evidence times prior.
class Search {
 public:
  Search(std::function<double(const Set&)> log_evidence, std::vector<std::size_t> candidates, std::size_t looks,
         std::size_t most)
      : log_evidence_(std::move(log_evidence)), candidates_(std::move(candidates)), most_(most) {
    const double none = std::exp2(-1.0 / static_cast<double>(std::max<std::size_t>(looks, 1)));
    log_odds_ = std::log1p(-none) - std::log(none);
    if (candidates_.size() > kCandidates) candidates_.resize(kCandidates);
  }

  /// The probability of each candidate.
  [[nodiscard]] std::map<std::size_t, double> run() {
    Set chosen;
    double best = weigh(chosen);
    for (bool better = true; better && chosen.size() < most_;) {
      better = false;
      Set next = chosen;
      const auto look = [&](const Set& set) {
        if (set.size() > most_) return;
        if (const double here = weigh(set); here > best) {
          best = here;
          next = set;
          better = true;
        }
      };
      for (const std::size_t one : candidates_) {
        look(with(chosen, {one}));
      }
      for (std::size_t a = 0; a < std::min(kPairsAmong, candidates_.size()); ++a)
        for (std::size_t b = a + 1; b < std::min(kPairsAmong, candidates_.size()); ++b)
          look(with(chosen, {candidates_[a], candidates_[b]}));
      chosen = next;
    }
    std::vector<double> all;
    for (const auto& [set, weight] : weights_) all.push_back(weight);
    const double total = log_sum(all);
    std::map<std::size_t, double> out;
    for (const auto& [set, weight] : weights_)
      for (const std::size_t one : set) out[one] += std::exp(weight - total);
    for (auto& [one, probability] : out) probability = std::min(probability, 1.0);
    return out;
  }

 private:
  static Set with(Set set, std::initializer_list<std::size_t> more) {
    set.insert(more);
    return set;
  }
  double weigh(const Set& set) {
    const auto [at, fresh] = weights_.try_emplace(set, 0.0);
    if (fresh) at->second = log_evidence_(set) + log_odds_ * static_cast<double>(set.size());
    return at->second;
  }
  std::function<double(const Set&)> log_evidence_;
  std::vector<std::size_t> candidates_;
  std::size_t most_;
  double log_odds_ = 0.0;
  std::map<Set, double> weights_;
};

/// Standard deviations in equal ratios from where they no longer matter to where the prior ends, and ln of their
/// weights in an integral: the first stands for all that are smaller.
struct LogAxis {
  std::vector<double> sd, log_weight;

  LogAxis(bool shown, double unit) {
    if (!shown) {
      sd = {0.0};
      log_weight = {0.0};
      return;
    }
    constexpr int kNodes = 14;
    constexpr double kLeast = 3e-3, kMost = 10.0;
    const double step = std::log(kMost / kLeast) / (kNodes - 1);
    for (int i = 0; i < kNodes; ++i) {
      sd.push_back(unit * kLeast * std::exp(step * i));
      log_weight.push_back(std::log(sd.back() * (i == 0 ? 1.0 : step)));
    }
  }
};

double robust_spread(const std::vector<double>& values) {
  const double middle = base::median(values);
  std::vector<double> off;
  off.reserve(values.size());
  for (const double v : values) off.push_back(std::abs(v - middle));
  return base::median(off) / base::kNormalQuartile;
}

/// How far off an outlier is taken to be. One that is much further off would be even less likely with five spreads than
/// with a scatter of all that is as wide as its own distance: a slip of the decimal point would belong to the others.
double outlier_sd(double spread, double off) {
  return std::max(kSpreads * spread, std::abs(off));
}

class Judge {
 public:
  Judge(std::span<const Measurement> measurements, const Pooled& pooled, const OutlierOptions& options)
      : measurements_(measurements), pooled_(pooled), options_(options), model_(measurements, pooled.actuators.size()) {
    inflation_.measurement.assign(measurements.size(), 0.0);
  }

  [[nodiscard]] std::vector<Outlier> recordings() {
    // Off from what the actuator's line lets one expect, by robust measures.
    std::vector<double> off(measurements_.size());
    for (std::size_t k = 0; k < off.size(); ++k) off[k] = measurements_[k].value - expected_of(k);
    const double spread = std::max(robust_spread(off), median_error());
    if (!model_.shown().repetition || measurements_.size() < 5) return {};
    const auto candidates = furthest(measurements_.size(), [&](std::size_t k) {
      return std::abs(off[k]) / std::hypot(spread, measurements_[k].standard_error);
    });
    const LogAxis repetition(model_.shown().repetition, model_.scatter()), cell(model_.shown().cell, model_.scatter());
    const auto evidence = [&](const Set& set) {
      Inflation with = inflation_;
      for (const std::size_t k : set) with.measurement[k] = std::pow(outlier_sd(spread, off[k]), 2);
      std::vector<double> parts;
      for (std::size_t r = 0; r < repetition.sd.size(); ++r) {
        const auto cells = model_.cells(repetition.sd[r], with);
        for (std::size_t c = 0; c < cell.sd.size(); ++c)
          parts.push_back(density({pooled_.scales.level, pooled_.scales.slope, cell.sd[c], repetition.sd[r]},
                                  model_.actuators(cells, cell.sd[c]), with) +
                          repetition.log_weight[r] + cell.log_weight[c]);
      }
      return log_sum(parts);
    };
    const auto found = Search(evidence, candidates, options_.recording_looks, measurements_.size() / 5).run();
    std::vector<Outlier> out;
    for (const auto& [k, probability] : found) {
      if (probability <= 0.5) continue;
      inflation_.measurement[k] =
          1e6 * std::pow(outlier_sd(spread, off[k]), 2);  // out of the pool, for the actuators as well
      out.push_back({k, probability, false, 0.0, 0.0, 0.0});
    }
    for (Outlier& one : out) measure_recording(one);
    return sorted(std::move(out));
  }

  [[nodiscard]] std::vector<Outlier> actuators() {
    std::vector<std::size_t> present;
    for (std::size_t i = 0; i < pooled_.actuators.size(); ++i)
      if (pooled_.actuators[i].measurements > 0) present.push_back(i);
    if (present.size() < 4) return {};
    sums_ = model_.actuators(model_.cells(pooled_.scales.repetition, inflation_), pooled_.scales.cell);
    std::vector<double> levels, errors;
    for (const std::size_t i : present) {
      levels.push_back(own(i).level);
      errors.push_back(own(i).level_error);
    }
    const double middle = base::median(levels);
    level_spread_ = std::max(robust_spread(levels), base::median(errors));
    std::vector<double> far(2 * pooled_.actuators.size(), -1.0);
    off_.assign(far.size(), 0.0);
    for (const std::size_t i : present) {
      off_[2 * i] = own(i).level - middle;
      far[2 * i] = std::abs(off_[2 * i]) / std::hypot(level_spread_, own(i).level_error);
    }
    if (model_.shown().slope) measure_slopes(present, far);
    auto candidates = furthest(far.size(), [&](std::size_t one) { return far[one]; });
    std::erase_if(candidates, [&](std::size_t one) { return far[one] < 0.0; });
    const auto found = Search([&](const Set& set) { return log_sum(over_spreads(set)); }, candidates,
                              2 * options_.actuator_looks, (present.size() - 1) / 2)
                           .run();
    // Its level or its slope: which of the two the data may leave open.
    std::map<std::size_t, double> of_actuator;
    Set named;
    for (const auto& [one, probability] : found) of_actuator[one / 2] += probability;
    std::vector<Outlier> out;
    for (const auto& [i, probability] : of_actuator) {
      if (probability <= 0.5) continue;
      named.insert({2 * i, 2 * i + 1});
      out.push_back({i, std::min(probability, 1.0), false, 0.0, 0.0, 0.0});
    }
    if (!out.empty()) measure_actuators(out, named);
    return sorted(std::move(out));
  }

 private:
  struct Own {
    double level = 0.0, level_error = 0.0, slope = 0.0, slope_error = 0.0;
  };

  [[nodiscard]] double median_error() const {
    std::vector<double> errors;
    for (const Measurement& m : measurements_) errors.push_back(m.standard_error);
    return base::median(errors);
  }

  /// By the actuator's own level and slope as pooled; robust enough to order candidates.
  [[nodiscard]] double expected_of(std::size_t k) const {
    const Measurement& m = measurements_[k];
    const auto& actuator = pooled_.actuators[m.actuator];
    return actuator.level.value +
           (actuator.slope ? actuator.slope->value * (m.pressure_psi - pooled_.mean_pressure_psi) : 0.0);
  }

  template <class Far>
  [[nodiscard]] static std::vector<std::size_t> furthest(std::size_t count, const Far& far) {
    std::vector<std::size_t> order(count);
    for (std::size_t i = 0; i < count; ++i) order[i] = i;
    std::ranges::stable_sort(order, std::greater<>(), far);
    return order;
  }
  [[nodiscard]] static std::vector<Outlier> sorted(std::vector<Outlier> list) {
    std::ranges::stable_sort(list, std::greater<>(), &Outlier::probability);
    return list;
  }

  [[nodiscard]] double density(const Scales& scales, const std::vector<VarianceModel::ActuatorSums>& sums,
                               const Inflation& with) const {
    return model_.solve(sums, scales.level, scales.slope, slope_prior_sd(model_), with).log_likelihood +
           log_prior(model_, scales);
  }

  /// From its own recordings alone; a level at the mean pressure of the pool.
  [[nodiscard]] Own own(std::size_t i) const {
    const Eigen::Matrix2d& a = sums_[i].precision;
    const Eigen::Vector2d& u = sums_[i].moment;
    if (a(1, 1) > 0.0 && a.determinant() > 1e-9 * a(0, 0) * a(1, 1)) {
      const Eigen::Matrix2d c = a.inverse();
      const Eigen::Vector2d at = c * u;
      return {at(0), std::sqrt(c(0, 0)), at(1), std::sqrt(c(1, 1))};
    }
    const double slope = pooled_.slope ? pooled_.slope->value : 0.0;
    return {(u(0) - slope * a(0, 1)) / a(0, 0), std::sqrt(1.0 / a(0, 0)), 0.0, 0.0};
  }
  void measure_slopes(const std::vector<std::size_t>& present, std::vector<double>& far) {
    std::vector<double> slopes, errors;
    for (const std::size_t i : present)
      if (own(i).slope_error > 0.0) {
        slopes.push_back(own(i).slope);
        errors.push_back(own(i).slope_error);
      }
    if (slopes.size() < 4) return;
    slope_spread_ = std::max(robust_spread(slopes), base::median(errors));
    for (const std::size_t i : present)
      if (own(i).slope_error > 0.0) {
        off_[2 * i + 1] = own(i).slope - base::median(slopes);
        far[2 * i + 1] = std::abs(off_[2 * i + 1]) / std::hypot(slope_spread_, own(i).slope_error);
      }
  }

  /// ln of the evidence at each node of the spreads between actuators; `visit` sees the nodes. `set`: twice the
  /// actuator for its level, and one more for its slope.
  [[nodiscard]] std::vector<double> over_spreads(
      const Set& set, const std::function<void(const Scales&, const VarianceModel::Solution&)>& visit = {}) const {
    Inflation with = inflation_;
    with.level.assign(pooled_.actuators.size(), 0.0);
    with.slope.assign(pooled_.actuators.size(), 0.0);
    for (const std::size_t one : set)
      (one % 2 == 0 ? with.level : with.slope)[one / 2] =
          std::pow(outlier_sd(one % 2 == 0 ? level_spread_ : slope_spread_, off_[one]), 2);
    const LogAxis level(model_.shown().level, model_.scatter());
    const LogAxis slope(model_.shown().slope,
                        model_.pressure_sd_psi() > 0.0 ? model_.scatter() / model_.pressure_sd_psi() : 0.0);
    std::vector<double> parts;
    for (std::size_t l = 0; l < level.sd.size(); ++l)
      for (std::size_t s = 0; s < slope.sd.size(); ++s) {
        const Scales scales{level.sd[l], slope.sd[s], pooled_.scales.cell, pooled_.scales.repetition};
        parts.push_back(density(scales, sums_, with) + level.log_weight[l] + slope.log_weight[s]);
        if (visit) visit(scales, model_.solve(sums_, scales.level, scales.slope, slope_prior_sd(model_), with));
      }
    return parts;
  }

  /// How far the named lie from what the rest lets one expect, the spreads of the rest integrated over.
  void measure_actuators(std::vector<Outlier>& named, const Set& set) const {
    std::vector<std::pair<Scales, VarianceModel::Solution>> nodes;
    const auto parts = over_spreads(set, [&](const Scales& scales, const auto& at) { nodes.emplace_back(scales, at); });
    const double total = log_sum(parts);
    Eigen::Vector2d mean = Eigen::Vector2d::Zero(), second = Eigen::Vector2d::Zero();
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      const double weight = std::exp(parts[n] - total);
      const auto& [scales, at] = nodes[n];
      const Eigen::Vector2d variance(at.covariance(0, 0) + scales.level * scales.level,
                                     at.covariance(1, 1) + scales.slope * scales.slope);
      mean += weight * at.mean;
      second += weight * (at.mean.cwiseAbs2() + variance);
    }
    const Eigen::Vector2d variance = second - mean.cwiseAbs2();
    for (Outlier& one : named) {
      const Own of = own(one.index);
      const double level = of.level - mean(0), slope = of.slope - mean(1);
      const double level_z = level / std::hypot(std::sqrt(variance(0)), of.level_error);
      const double slope_z = of.slope_error > 0.0 ? slope / std::hypot(std::sqrt(variance(1)), of.slope_error) : 0.0;
      one.slope = std::abs(slope_z) > std::abs(level_z);
      one.expected = one.slope ? mean(1) : mean(0);
      one.difference = one.slope ? slope : level;
      one.deviations = one.slope ? slope_z : level_z;
    }
  }

  /// From the actuator's line without the recordings that stand out.
  void measure_recording(Outlier& one) const {
    const Measurement& m = measurements_[one.index];
    const auto sums = model_.actuators(model_.cells(pooled_.scales.repetition, inflation_), pooled_.scales.cell);
    const auto solution = model_.solve(sums, pooled_.scales.level, pooled_.scales.slope, slope_prior_sd(model_));
    const auto line = VarianceModel::own(sums[m.actuator], solution, pooled_.scales.level, pooled_.scales.slope);
    const Eigen::Vector2d z(1.0, model_.shown().pressures ? m.pressure_psi - model_.mean_pressure_psi() : 0.0);
    // The others of its cell say where the cell lies, the line only where it is expected.
    std::vector<double> near, all;
    for (std::size_t k = 0; k < measurements_.size(); ++k) {
      if (inflation_.measurement[k] > 0.0) continue;
      const double off = measurements_[k].value - expected_of(k);
      all.push_back(off);
      if (model_.cell_of(k) == model_.cell_of(one.index)) near.push_back(measurements_[k].value);
    }
    one.expected = z.dot(line.mean);
    double variance = z.dot(line.covariance * z) + std::pow(pooled_.scales.cell, 2);
    if (near.size() > 1) {
      one.expected = base::median(near);
      variance = std::pow(robust_spread(all), 2) / static_cast<double>(near.size());
    }
    one.difference = m.value - one.expected;
    const double spread = std::min(robust_spread(all), std::hypot(pooled_.scales.repetition, pooled_.scales.cell));
    one.deviations = one.difference / std::sqrt(variance + spread * spread + m.standard_error * m.standard_error);
  }

  std::span<const Measurement> measurements_;
  const Pooled& pooled_;
  const OutlierOptions& options_;
  VarianceModel model_;
  Inflation inflation_;
  std::vector<VarianceModel::ActuatorSums> sums_;
  double level_spread_ = 0.0, slope_spread_ = 0.0;
  std::vector<double> off_;  ///< of each actuator's level and slope from the middle of all
};

}  // namespace

Outliers find_outliers(std::span<const Measurement> measurements, const Pooled& pooled, const OutlierOptions& options) {
  Judge judge(measurements, pooled, options);
  Outliers out;
  out.recordings = judge.recordings();
  out.actuators = judge.actuators();
  return out;
}

}  // namespace isorig::identify::pooling
