#pragma once
#include <vector>

#include "base/toml_reader.hpp"
#include "protocol/syntax.hpp"

namespace isorig::protocol {

/// More than this is a slip of the pen, not an experiment (the paper's protocol has 880 steps).
inline constexpr double kMaxSteps = 100'000;
/// Turns of repeats, which cost time even round an empty list of steps.
inline constexpr double kMaxTurns = 200'000;

/// Counts the steps and turns that the tree comes to, without walking them: how often a repeat turns does not depend
/// on any variable. False when they are too many: noted at the innermost repeat that is too long by itself, with its
/// count, or at `steps` where only the sum is.
[[nodiscard]] bool within_budget(const std::vector<syntax::Node>& steps, const base::TomlTable& root);

}  // namespace isorig::protocol
