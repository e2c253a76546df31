#pragma once
#include <nlohmann/json.hpp>

/// The terminal's verdicts on the loop and the devices, for the page: one rule and one wording for both.
namespace isorig::web {

/// Of a status as the daemon sends it: `loop`, `frame` and `pressure`, each with `tone` (good, warn, bad) and `text`. A
/// part that the status lacks, or has in another form, is not there.
[[nodiscard]] nlohmann::json verdicts_of(const nlohmann::json& status);

}  // namespace isorig::web
