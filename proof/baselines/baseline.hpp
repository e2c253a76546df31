#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"
#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

/// What a diagnosis has to beat, done simply and by the book (docs/proof.md): names in the order of
/// run_baselines' answer.
[[nodiscard]] std::span<const std::string_view> baselines();

/// Every baseline on one case. The heldout recording's forces are not looked at; `truth_N` only measures.
[[nodiscard]] std::vector<Outcome> run_baselines(const messages::Recording& train, const messages::Recording& heldout,
                                                 const std::string& nominal, const std::vector<double>& truth_N,
                                                 const std::string& case_name);

}  // namespace isorig::proof
