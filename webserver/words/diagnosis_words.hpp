#pragma once
#include <nlohmann/json.hpp>

namespace isorig::web {

/// For people, of a list of diagnoses as the daemon sends it: beside each number of a missing effect its unit from the
/// effect's sheet (`unit`; none for a ratio) and its name without the unit (`words`); notes, warnings and reasons with
/// the words of effects in place of their names. What no sheet has stays as it is.
void put_in_words(nlohmann::json& list);

}  // namespace isorig::web
