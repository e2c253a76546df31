#include "identify/pooling/scale_grid.hpp"

#include <algorithm>
#include <cmath>

#include "identify/pooling/mixed_model.hpp"

namespace isorig::identify::pooling {
namespace {

constexpr std::size_t kNodes = 9;
/// e^-8 of the highest density is left out beyond the ends of an axis, before the first pass widens them.
constexpr double kDrop = 8.0;
/// Half-normal with a scale of three scatters: beyond twelve of them is less than a ten thousandth of the prior.
constexpr double kMost = 12.0;

using Point = std::array<double, kAxes>;

Scales scales_of(const Point& at) {
  return {at[kLevel], at[kSlope], at[kCell], at[kRepetition]};
}

/// What a standard deviation is measured in: the scatter, of slopes that per sd of the pressure.
double unit_of(const VarianceModel& model, std::size_t axis) {
  return axis == kSlope && model.pressure_sd_psi() > 0.0 ? model.scatter() / model.pressure_sd_psi() : model.scatter();
}

bool shown(const VarianceModel& model, std::size_t axis) {
  const Shown& s = model.shown();
  const std::array<bool, kAxes> all{s.repetition, s.cell, s.slope, s.level};
  return all[axis];
}

double log_density(const VarianceModel& model, const VarianceModel::Solution& at, const Scales& scales,
                   bool with_slope) {
  return (with_slope ? at.log_likelihood : at.log_evidence_constant) + log_prior(model, scales);
}

class Finder {
 public:
  Finder(const VarianceModel& model, bool with_slope) : model_(model), with_slope_(with_slope) {}

  [[nodiscard]] double density(const Point& at) const {
    const auto sums = model_.actuators(model_.cells(at[kRepetition]), at[kCell]);
    const auto solution = model_.solve(sums, at[kLevel], at[kSlope], slope_prior_sd(model_));
    return log_density(model_, solution, scales_of(at), with_slope_);
  }

  [[nodiscard]] Point mode() const {
    Point at{};
    for (std::size_t axis = 0; axis < kAxes; ++axis)
      if (shown(model_, axis)) at[axis] = 0.5 * unit_of(model_, axis);
    double best = density(at);
    constexpr int kSweeps = 3, kSteps = 22;
    for (int sweep = 0; sweep < kSweeps; ++sweep)
      for (std::size_t axis = 0; axis < kAxes; ++axis) {
        if (!shown(model_, axis)) continue;
        Point trial = at;
        for (int step = 0; step <= kSteps; ++step) {
          // 0, then 0.001 to 5 units in equal ratios.
          trial[axis] = step == 0 ? 0.0 : unit_of(model_, axis) * 1e-3 * std::pow(5e3, (step - 1.0) / (kSteps - 1.0));
          const double here = density(trial);
          if (here > best) {
            best = here;
            at = trial;
          }
        }
      }
    return at;
  }

  /// From `mode` along an axis, until the density has dropped; twice as far, since the others may move with it.
  [[nodiscard]] std::pair<double, double> reach(const Point& mode, std::size_t axis) const {
    const double unit = unit_of(model_, axis), top = density(mode);
    Point trial = mode;
    double step = std::max(0.02 * mode[axis], 1e-3 * unit), high = mode[axis];
    for (; high < kMost * unit; step *= 1.5) {
      trial[axis] = high += step;
      if (density(trial) < top - kDrop) break;
    }
    step = std::max(0.02 * mode[axis], 1e-3 * unit);
    double low = mode[axis];
    for (; low > 0.0; step *= 1.5) {
      trial[axis] = low = std::max(low - step, 0.0);
      if (density(trial) < top - kDrop) break;
    }
    return {std::max(0.0, 2.0 * low - mode[axis]), std::min(2.0 * high - mode[axis], kMost * unit)};
  }

 private:
  const VarianceModel& model_;
  bool with_slope_;
};

/// Where the mass is, and one node more on each side.
ScaleAxis narrowed(const ScaleAxis& axis, const std::vector<double>& mass, double bend) {
  constexpr double kNothing = 3e-6;
  const double most = *std::ranges::max_element(mass);
  std::size_t first = 0, last = mass.size() - 1;
  while (first < last && mass[first] < kNothing * most) ++first;
  while (last > first && mass[last] < kNothing * most) --last;
  return {axis.sd[first > 0 ? first - 1 : 0], axis.sd[std::min(last + 1, mass.size() - 1)], bend};
}

}  // namespace

ScaleAxis::ScaleAxis(double low, double high, double bend) : sd(kNodes), log_weight(kNodes) {
  const double from = std::asinh(low / bend), step = (std::asinh(high / bend) - from) / static_cast<double>(kNodes - 1);
  for (std::size_t i = 0; i < kNodes; ++i) {
    const double x = from + step * static_cast<double>(i);
    sd[i] = i == 0 ? low : bend * std::sinh(x);
    log_weight[i] = std::log(step * bend * std::cosh(x)) + (sd[i] == 0.0 ? std::log(0.5) : 0.0);
  }
}

double slope_prior_sd(const VarianceModel& model) {
  return model.pressure_sd_psi() > 0.0 ? model.total_scatter() / model.pressure_sd_psi() : 1.0;
}

double log_sum(const std::vector<double>& values) {
  const double most = *std::ranges::max_element(values);
  double sum = 0.0;
  for (const double value : values) sum += std::exp(value - most);
  return most + std::log(sum);
}

void each_node(const VarianceModel& model, const ScaleGrid& grid, bool with_slope,
               const std::function<void(const Node&, const std::vector<VarianceModel::ActuatorSums>&)>& visit) {
  for (std::size_t r = 0; r < grid[kRepetition].sd.size(); ++r) {
    const auto cells = model.cells(grid[kRepetition].sd[r]);
    for (std::size_t c = 0; c < grid[kCell].sd.size(); ++c) {
      const auto sums = model.actuators(cells, grid[kCell].sd[c]);
      for (std::size_t s = 0; s < grid[kSlope].sd.size(); ++s)
        for (std::size_t l = 0; l < grid[kLevel].sd.size(); ++l) {
          Node node{{grid[kLevel].sd[l], grid[kSlope].sd[s], grid[kCell].sd[c], grid[kRepetition].sd[r]}, 0.0, {}};
          node.solution = model.solve(sums, node.scales.level, node.scales.slope, slope_prior_sd(model));
          node.log_weight = log_density(model, node.solution, node.scales, with_slope) +
                            grid[kRepetition].log_weight[r] + grid[kCell].log_weight[c] + grid[kSlope].log_weight[s] +
                            grid[kLevel].log_weight[l];
          visit(node, sums);
        }
    }
  }
}

ScaleGrid find_grid(const VarianceModel& model, bool with_slope) {
  const Finder finder(model, with_slope);
  const Point mode = finder.mode();
  ScaleGrid grid;
  Point bend{};
  for (std::size_t axis = 0; axis < kAxes; ++axis) {
    if (!shown(model, axis)) continue;
    const auto [low, high] = finder.reach(mode, axis);
    bend[axis] = std::max(mode[axis], 0.1 * high);
    grid[axis] = ScaleAxis(low, high, bend[axis]);
  }
  std::vector<double> log_weights;
  each_node(model, grid, with_slope, [&](const Node& node, const auto&) { log_weights.push_back(node.log_weight); });
  const double most = *std::ranges::max_element(log_weights);
  std::array<std::vector<double>, kAxes> mass;
  for (std::size_t axis = 0; axis < kAxes; ++axis) mass[axis].assign(grid[axis].sd.size(), 0.0);
  std::size_t at = 0;
  for (std::size_t r = 0; r < grid[kRepetition].sd.size(); ++r)
    for (std::size_t c = 0; c < grid[kCell].sd.size(); ++c)
      for (std::size_t s = 0; s < grid[kSlope].sd.size(); ++s)
        for (std::size_t l = 0; l < grid[kLevel].sd.size(); ++l) {
          const double weight = std::exp(log_weights[at++] - most);
          mass[kRepetition][r] += weight;
          mass[kCell][c] += weight;
          mass[kSlope][s] += weight;
          mass[kLevel][l] += weight;
        }
  for (std::size_t axis = 0; axis < kAxes; ++axis)
    if (shown(model, axis)) grid[axis] = narrowed(grid[axis], mass[axis], bend[axis]);
  return grid;
}

}  // namespace isorig::identify::pooling
