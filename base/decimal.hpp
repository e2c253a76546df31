#pragma once
#include <optional>
#include <string>
#include <string_view>

namespace isorig::base {

/// The number that `text` is, whole, blanks round it aside: "12.5", "-3", "1e-3". Nothing when there is anything else
/// in it; `why` then says what and what to do ("12,5": a decimal comma; "7 kPa": something behind the number).
[[nodiscard]] std::optional<double> decimal(std::string_view text, std::string& why);

}  // namespace isorig::base
