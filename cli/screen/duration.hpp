#pragma once
#include <string>

namespace isorig::cli {

/// "23 h 01 min", "3 min 42 s", "12.5 s"
[[nodiscard]] std::string duration_text(double seconds);

}  // namespace isorig::cli
