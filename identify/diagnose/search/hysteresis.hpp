#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// What `selection` leaves unexplained, described by what was before: a branch that the specimen is on,
/// structure that motion breaks, a wave in time, a force channel that rings
/// (model/memory.cpp). Each beside the nominal model and beside the effects that were found, fitted jointly;
/// each judged on blocks of moves that it was not fitted to, against what stands there now. Taken only when
/// the mean gain over the blocks is more than one standard error, and a tenth of what is lacking: the
/// simplest is what is there. Names and probabilities are not touched.
struct HysteresisDescription {
  model::ModelSpec spec;
  std::string function_of;
};
[[nodiscard]] std::optional<HysteresisDescription> describe_hysteresis(const Search& search, const Selection& selection,
                                                                       unsigned threads);

}  // namespace isorig::identify
