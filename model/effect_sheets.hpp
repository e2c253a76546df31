#pragma once
#include <string>

#include "model/process.hpp"

namespace isorig::model {

/// What a person must know of an entry of the catalogue: what it is, source, what reveals it, its laws, and every
/// number with unit, range, the reason for the range, and what makes it wrong. Markdown, legible as it is.
[[nodiscard]] std::string sheet_text(const Physics& physics);

/// One line for each effect: its name, where it acts, its laws.
[[nodiscard]] std::string effects_table();

/// docs/effect-sheets.md: the table and the sheets of all effects.
[[nodiscard]] std::string effect_sheets_document();

/// A parameter's range or a coefficient's sign: "0.02 to 50"; "either sign", "not negative".
[[nodiscard]] std::string range_text(const Parameter& parameter);
[[nodiscard]] std::string_view range_text(const Coefficient& coefficient) noexcept;

}  // namespace isorig::model
