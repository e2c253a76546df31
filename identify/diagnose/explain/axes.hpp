#pragma once
#include <array>
#include <string>
#include <vector>

#include "identify/diagnose/fit/covariates.hpp"

namespace isorig::identify {

/// Cells of a variable, in groups of `per_group` neighbours: one group, or one for each direction of the last
/// motion.
struct Cells {
  std::vector<int> cell;  // -1: not seen
  int count = 0;
  int per_group = 0;
  std::vector<double> edges;  // of a group's cells, both ends included; empty: the groups say all
};

/// A covariate cut into cells, with the words for them.
struct Axis {
  std::string name;
  Cells cells;
  const char* unit = "";  ///< of the edges
  const char* after = "";
  std::array<const char*, 3> groups{};
};
[[nodiscard]] std::vector<Axis> axes_of(const Covariates& of, bool several_recordings);

/// The same cells whichever group they are in.
[[nodiscard]] Cells without_groups(Cells cells);

}  // namespace isorig::identify
