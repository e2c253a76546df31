#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace isorig::base {

/// What a TOML text may ask of the parser. Each limit is far above what anybody writes by hand and keeps any text of
/// the largest size below 100 MB and a second: a parsed value takes some 100 bytes, a nested table some 300 and a stack
/// frame when it is destroyed.
inline constexpr std::size_t kMaxTomlBytes = std::size_t{4} << 20U;
inline constexpr std::uint32_t kMaxTomlValues = 200'000;  ///< keys, elements and tables
inline constexpr std::uint32_t kMaxTomlBrackets = 64;     ///< arrays and inline tables in each other
inline constexpr std::uint32_t kMaxTomlDots = 32;         ///< parts of a dotted key

struct OverBudget {
  std::uint32_t line = 0, column = 0;
  std::string message;
};

/// Looks at brackets, dots and separators outside of strings and comments, before the text is parsed: the parser
/// builds whatever it is given, and a table nested a million deep cannot even be destroyed. Nothing: within budget.
[[nodiscard]] std::optional<OverBudget> over_budget(std::string_view text);

}  // namespace isorig::base
