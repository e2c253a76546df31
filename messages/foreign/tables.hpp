#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::foreign {

/// One line of a delimited file.
struct Line {
  std::size_t number = 0;  ///< in the file, from 1; of its first, where a quoted cell has line ends
  std::vector<std::string> cells;
  bool last_cell_quoted = false;
};

struct Column {
  std::string name;           ///< without its unit; "" in a table without a header
  std::string unit;           ///< as the file has it, without brackets; "" where it says none
  std::size_t unit_line = 0;  ///< of the row of units that says it; 0: it stands with the name
};

/// Rows of numbers below a header, or without one. Cells are as they stand in the file.
struct Table {
  std::size_t line = 0;  ///< of its header, or of its first row
  std::vector<Column> columns;
  std::vector<Line> rows;
};

struct Parsed {
  char delimiter = ',';  ///< ' ' for runs of blanks
  char decimal = '.';
  std::vector<Table> tables;
  std::vector<std::string> header;  ///< the lines that are in no table, as "key = value"
};

/// What a file does not say, as the mapping or the command line does.
struct Dialect {
  std::optional<char> delimiter;
  std::optional<char> decimal;
};

/// Finds the tables of a file. `text` is UTF-8 (decoded_text.hpp). Cells in double quotes may hold delimiters (RFC
/// 4180). A table ends with an empty line, with the next header or with the file; any other line that is no row of it
/// is a fault, as is a last line that may have been cut. Throws RecordingError with the line.
[[nodiscard]] Parsed parse_tables(const std::string& text, const std::filesystem::path& file, const Dialect& dialect);

/// The number that a cell holds; nothing when it is none. The other mark, blanks and apostrophes may group thousands.
[[nodiscard]] std::optional<double> number_of(std::string_view cell, char decimal);

/// Seconds since midnight of a time of day, behind a date or without: "10:15:00.25", "2026-11-29T10:15:00,25Z",
/// "10:15:00.25 PM"; of "15:00.25", minutes and seconds, since the hour. Nothing of anything else.
[[nodiscard]] std::optional<double> clock_s(std::string_view cell);

/// A number in any notation: only what it is made of is looked at.
[[nodiscard]] bool looks_numeric(std::string_view cell);

/// The decimal mark, by all cells of tables that look like numbers: lines above a table may be of another program, or
/// hold a version ("2.5"). Throws RecordingError where marks are mixed, or where every number may be read both ways
/// ("1,234").
[[nodiscard]] char decimal_of(const std::vector<Table>& tables, char delimiter, const std::filesystem::path& file);

}  // namespace isorig::foreign
