#pragma once
#include <cstdint>
#include <string>

namespace isorig::base {

/// A moment in UTC, as files and answers have it ("2026-11-23T14:05:09Z") or by another format of strftime.
[[nodiscard]] std::string utc_text(std::int64_t unix_s, const char* format = "%Y-%m-%dT%H:%M:%SZ");

}  // namespace isorig::base
