#pragma once
#include <array>
#include <functional>
#include <vector>

#include "identify/pooling/variance_model.hpp"

namespace isorig::identify::pooling {

/// Order of the axes: what is summed anew least often comes last.
enum Axis : std::size_t { kRepetition, kCell, kSlope, kLevel, kAxes };

/// A standard deviation at m sinh(x), x evenly spaced: as a line near zero, where the density of a few actuators has
/// its mode, and in equal ratios in its long tail. A density depends on the square of a standard deviation, so that it
/// is even in x, and the trapezoidal rule with half a weight at zero converges as fast as on a whole line.
struct ScaleAxis {
  std::vector<double> sd{0.0};
  std::vector<double> log_weight{0.0};  ///< of a node in an integral over the standard deviation

  ScaleAxis() = default;
  ScaleAxis(double low, double high, double bend);
};

/// The standard deviations of a VarianceModel on a grid that holds all but a millionth of their posterior.
using ScaleGrid = std::array<ScaleAxis, kAxes>;

/// The grid for a density: its mode is found along each axis in turn, its reach from there, and a first pass over a
/// grid that is wider says where the mass is.
[[nodiscard]] ScaleGrid find_grid(const VarianceModel& model, bool with_slope);

/// A node of the grid: what the model says there, and ln of its posterior density with the weight of the node.
struct Node {
  Scales scales;
  double log_weight = 0.0;
  VarianceModel::Solution solution;
};

/// Goes through all nodes; `sums` are those of the node's repetition_sd and cell_sd.
void each_node(const VarianceModel& model, const ScaleGrid& grid, bool with_slope,
               const std::function<void(const Node&, const std::vector<VarianceModel::ActuatorSums>& sums)>& visit);

/// ln of the sum of exp(values).
[[nodiscard]] double log_sum(const std::vector<double>& values);

/// The sd of the normal prior of a common slope, for its evidence against none.
[[nodiscard]] double slope_prior_sd(const VarianceModel& model);

}  // namespace isorig::identify::pooling
