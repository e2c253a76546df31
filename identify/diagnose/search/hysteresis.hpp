#pragma once
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// The unexplained residual of `selection`, described by something that fits in few numbers: products of a state with
/// a factor (discovery.hpp), a branch that the specimen is on, structure that motion breaks, a wave in time, a force
/// channel that rings (model/memory.cpp). Each beside the nominal model and beside the effects that were found, fitted
/// jointly; each judged on blocks of the recordings that it was not fitted to, against the explanation without it.
/// Taken only when the mean gain over the blocks is more than one standard error and more than a tenth of the
/// unexplained squares. Of what passes, the greatest gain; but products, which are laws, before a memory whose gain is
/// greater by less than its own standard error, and fewer products before more in the same way. Names and probabilities
/// do not change.
struct HysteresisDescription {
  model::ModelSpec spec;
  std::string function_of;
  NoiseModel noise;                         ///< that it was fitted under
  std::map<std::string, double> inclusion;  ///< of products, by law (discovery.hpp); empty for a memory
};
enum class DescribeBy { kProductsAndMemory, kProducts };
[[nodiscard]] std::optional<HysteresisDescription> describe_hysteresis(const Search& search, const Selection& selection,
                                                                       unsigned threads,
                                                                       DescribeBy by = DescribeBy::kProductsAndMemory);

/// The model has a branch (model/memory.cpp).
[[nodiscard]] bool has_relay(const model::ModelSpec& spec);

/// Sets the thresholds of the model's branch by scanning: no gradient leads to them. The rest of the model stays.
void scan_relay(const Problem& problem, model::ModelSpec& spec);

}  // namespace isorig::identify
