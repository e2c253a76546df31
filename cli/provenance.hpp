#pragma once
#include <string>
#include <utility>
#include <vector>

#include "identify/report/page.hpp"

namespace isorig::cli {

/// By which command and version a report is made, and when; `inputs` say from what.
[[nodiscard]] identify::report::Made made_by_this_call(std::vector<std::pair<std::string, std::string>> inputs);

}  // namespace isorig::cli
