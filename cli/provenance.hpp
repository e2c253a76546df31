#pragma once
#include <string>
#include <utility>
#include <vector>

#include "identify/report/page.hpp"

namespace isorig::cli {

/// Reports of this call bear no time: the same inputs give the same bytes wherever and whenever they are made.
void leave_the_time_out();

/// Version and revision of this program, as reports have it.
[[nodiscard]] std::string version_and_revision();

/// By which command and version a report is made, and when; `inputs` say from what.
[[nodiscard]] identify::report::Made made_by_this_call(std::vector<std::pair<std::string, std::string>> inputs);

}  // namespace isorig::cli
