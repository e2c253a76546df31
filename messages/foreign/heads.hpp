#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "messages/foreign/tables.hpp"

/// What the lines of a delimited file are: names of columns, their units, rows.
namespace isorig::foreign {

/// Without blanks and tabs at its ends.
[[nodiscard]] std::string_view trimmed(std::string_view text);

/// "NaN", "NA", "#N/A": what a program writes where there is no value.
[[nodiscard]] bool says_no_value(std::string_view cell);

/// No cell has anything in it.
[[nodiscard]] bool is_blank(const Line& line);

/// Cells up to the last that is not empty: some programs end every line with a delimiter.
[[nodiscard]] std::size_t used_cells(const Line& line);
[[nodiscard]] std::size_t numeric_cells(const Line& line);

/// Two names or more, and no number nor what stands for one.
[[nodiscard]] bool is_names(const Line& line);

/// Cells of numbers, or a number beside "NaN" or its like, and none beyond the table's.
[[nodiscard]] bool is_row(const Line& line, std::size_t cells);

/// "(mm)" or "[mm]", without its brackets; nothing for another cell.
[[nodiscard]] std::optional<std::string> bracketed(std::string_view cell);

/// A name with the unit that stands with it: "Time (s)", "Kraft [N]".
[[nodiscard]] Column column_of(std::string_view cell);

/// Whether every cell of the line is a unit in brackets.
[[nodiscard]] bool is_bracketed_units(const Line& line);

/// Whether the line below a table's names has their units: all in brackets, or more than half of them known units, or
/// one that a name asks for ("s" below "Time"). A dash stands for none.
[[nodiscard]] bool is_units(const Line& names, const Line& line);

/// Names of a table, and what stands below them.
struct Head {
  std::size_t units = 0;  ///< lines of units: one or none
  std::size_t first = 0;  ///< index of the first line that is sure to be a row
};
/// Whether the table's names stand in line `at`. Before its first sure row may stand others: without a measured number
/// ("0.0,NaN,NaN", ",,"), or with a word in place of one ("0.0,overload,2") where the names say that they are some.
/// Another line of names is no row.
[[nodiscard]] std::optional<Head> head_at(const std::vector<Line>& lines, std::size_t at);

/// The first line below names, where the rows that begin with it have more cells than there are names.
[[nodiscard]] std::optional<std::size_t> wider_row_below(const std::vector<Line>& lines, std::size_t at);

}  // namespace isorig::foreign
