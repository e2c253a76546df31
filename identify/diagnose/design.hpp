#pragma once
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/select.hpp"

namespace isorig::identify {

/// What the rig may be asked for.
struct DesignLimits {
  double most_mm = 4.0;
  double fastest_mm_s = 10.0;
};

struct Experiment {
  std::string name;
  std::string protocol;  ///< TOML, isorig-protocol/1
  double duration_s = 0.0;
  double distance = 0.0;  ///< smallest whitened squared distance between two of the tied explanations
  std::vector<std::string> separates;
};

/// When explanations remain tied: of a menu of motions within the limits the shortest that separates every
/// two of them (each refitted freely to what the other predicts; Hunter-Reiner's criterion, worst pair
/// first), or the one that separates best. Empty when nothing is tied.
[[nodiscard]] std::optional<Experiment> design_experiment(const Search& search, const Selection& selection,
                                                          const DesignLimits& limits);

}  // namespace isorig::identify
