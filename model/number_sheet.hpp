#pragma once
#include <string>
#include <string_view>

#include "model/process.hpp"

namespace isorig::model {

/// Meaning and unit of a number of a law; null when the law has none of that name.
[[nodiscard]] const NumberSheet* sheet_of(const Law& law, std::string_view number);

/// What a number is, as part of a sentence: NumberSheet::what up to its first semicolon, "friction force at steady
/// sliding". Empty without a sheet.
[[nodiscard]] std::string meaning_of(const NumberSheet* sheet);

/// " N/mm" behind a value; "" for a ratio, and without a sheet.
[[nodiscard]] std::string unit_behind(const NumberSheet* sheet);

}  // namespace isorig::model
