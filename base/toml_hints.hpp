#pragma once
#include <cstddef>
#include <string>
#include <string_view>

/// What a mistake in a configuration file was most likely meant to be. Each hint begins with its own separator and is
/// empty where there is nothing to say.
namespace isorig::base {

/// For a line that is no TOML because its number has a decimal comma: `duration_s = 3,5`. Lines count from 1.
[[nodiscard]] std::string decimal_comma_hint(std::string_view text, std::size_t line);

/// For a key that is another one but for its unit: renaming `pressure_kPa` to `pressure_psi` without converting the
/// number would be seven times the pressure.
[[nodiscard]] std::string unit_hint(std::string_view key, std::string_view meant);

}  // namespace isorig::base
