#pragma once
#include <string_view>

namespace isorig::base {

/// Nothing, or nothing that can be seen: no name of anybody.
[[nodiscard]] constexpr bool is_blank(std::string_view text) noexcept {
  return text.find_first_not_of(" \t") == std::string_view::npos;
}

}  // namespace isorig::base
