#pragma once
#include <nlohmann/json.hpp>

namespace isorig::web {

/// Puts the unit of each number of a missing effect beside it, as `unit`, from the effect's sheet; a list of diagnoses
/// as the daemon sends it. A ratio, and a number that no sheet has, get none.
void add_units(nlohmann::json& list);

}  // namespace isorig::web
