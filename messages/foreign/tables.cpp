#include "messages/foreign/tables.hpp"

#include <algorithm>
#include <string_view>

#include "base/printable.hpp"
#include "messages/foreign/heads.hpp"
#include "messages/foreign/mapping.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {
namespace {

using Fault = messages::RecordingFault;
using messages::RecordingError;

std::string shown_cell(std::string_view cell) {
  return "\"" + base::printable(cell.substr(0, 40)) + (cell.size() > 40 ? "...\"" : "\"");
}

/// Lines of cells. A quote opens a quoted cell only where a cell begins.
std::vector<Line> split(const std::string& text, char delimiter, const std::filesystem::path& file) {
  std::vector<Line> lines;
  std::size_t number = 1, at = 0;
  while (at < text.size()) {
    Line line{.number = number, .cells = {}};
    bool ended = false;
    while (!ended) {
      if (delimiter == ' ')
        while (at < text.size() && (text[at] == ' ' || text[at] == '\t')) ++at;
      std::string cell;
      line.last_cell_quoted = at < text.size() && text[at] == '"';
      if (line.last_cell_quoted) {
        const std::size_t opened = number;
        for (++at;; ++at) {
          if (at >= text.size())
            throw RecordingError(Fault::kTruncated, file, opened,
                                 "a quote is opened and never closed: the file is cut or damaged");
          if (text[at] == '"' && !(at + 1 < text.size() && text[at + 1] == '"')) break;
          if (text[at] == '"') ++at;
          if (text[at] == '\n') ++number;
          cell += text[at];
        }
        ++at;
      }
      while (at < text.size() && text[at] != delimiter && text[at] != '\n' && text[at] != '\r' &&
             !(delimiter == ' ' && text[at] == '\t'))
        cell += text[at++];
      line.cells.emplace_back(trimmed(cell));
      if (delimiter == ' ')
        while (at < text.size() && (text[at] == ' ' || text[at] == '\t')) ++at;
      ended = at >= text.size() || text[at] == '\n' || text[at] == '\r';
      if (!ended && delimiter != ' ') ++at;
    }
    if (at < text.size()) {
      if (text[at] == '\r' && at + 1 < text.size() && text[at + 1] == '\n') ++at;
      ++at;
      ++number;
    }
    lines.push_back(std::move(line));
  }
  return lines;
}

/// How many cells of numbers stand in lines that have as many cells as the line before.
std::size_t tabular_cells(const std::vector<Line>& lines) {
  std::size_t count = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const std::size_t n = lines[i].cells.size();
    if (n >= 2 && n == lines[i - 1].cells.size() && numeric_cells(lines[i]) >= 2) count += numeric_cells(lines[i]);
  }
  return count;
}

class Finder {
 public:
  Finder(std::vector<Line>& lines, const std::filesystem::path& file) : lines_(lines), file_(file) {}

  void run(Parsed& parsed) {
    while (at_ < lines_.size()) {
      const Line& line = lines_[at_];
      if (const auto head = head_at(lines_, at_)) {
        parsed.tables.push_back(headed(*head));
      } else if (lacks_rows()) {
        throw RecordingError(
            Fault::kTruncated, file_, line.number + 2,
            "a table of " + std::to_string(used_cells(line)) + " columns has no row of as many numbers");
      } else if (used_cells(line) >= 2 && numeric_cells(line) == used_cells(line)) {
        if (!parsed.tables.empty())
          throw RecordingError(Fault::kColumns, file_, line.number,
                               "rows without a header behind an empty line: is something missing here? Take the empty "
                               "line out if they belong together, or put each test into a file of its own");
        parsed.tables.push_back(bare());
      } else if (const auto wider = wider_row_below(lines_, at_)) {
        refuse_rows(lines_[*wider], used_cells(line));
      } else if (!parsed.tables.empty() && is_row(line, std::max<std::size_t>(used_cells(line), 2))) {
        refuse_rows(line, parsed.tables.back().columns.size());
      } else {
        if (!is_blank(line)) parsed.header.push_back(said(line));
        ++at_;
      }
    }
  }

 private:
  /// Measured rows that would be lost: they stand where a table is, and are none of it.
  [[noreturn]] void refuse_rows(const Line& line, std::size_t columns) const {
    throw RecordingError(Fault::kColumns, file_, line.number,
                         std::to_string(used_cells(line)) + " cells with " + std::to_string(numeric_cells(line)) +
                             " numbers (" + shown_cell(line.cells.front()) +
                             " ...) belong to no table, where the header before has " + std::to_string(columns) +
                             " columns: name every column that the rows have, or take the line out if it is no "
                             "measurement");
  }

  /// Names and units below which the file ends, or, where the units are in brackets, something else stands.
  [[nodiscard]] bool lacks_rows() const {
    const Line& names = lines_[at_];
    if (!is_names(names) || is_bracketed_units(names) || at_ + 1 == lines_.size()) return false;
    const auto below = lines_.begin() + static_cast<std::ptrdiff_t>(at_ + 1);
    return is_bracketed_units(*below) || (is_units(names, *below) && std::all_of(below + 1, lines_.end(), is_blank));
  }

  Table headed(const Head& head) {
    const Line& names = lines_[at_];
    Table table{.line = names.number, .columns = {}, .rows = {}};
    for (std::size_t c = 0; c < used_cells(names); ++c) table.columns.push_back(column_of(names.cells[c]));
    if (head.units == 1) take_units(table, lines_[at_ + 1]);
    at_ += 1 + head.units;
    take_rows(table, &names, head.first);
    return table;
  }

  void take_units(Table& table, const Line& line) const {
    if (line.cells.size() < table.columns.size() || used_cells(line) > table.columns.size())
      throw RecordingError(
          Fault::kColumns, file_, line.number,
          std::to_string(used_cells(line)) + " units for " + std::to_string(table.columns.size()) + " columns");
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const std::string_view cell = trimmed(line.cells[c]);
      if (cell.find_first_not_of('-') == std::string_view::npos) continue;
      Column& column = table.columns[c];
      const std::string unit = bracketed(cell).value_or(std::string(cell));
      refuse_two_units(column, c, unit, line.number);
      column.unit = unit;
      column.unit_line = line.number;
    }
  }

  /// "Load (kN)" or "load_kN" above "N": whichever is taken may be wrong by a factor. Behind a low line some units may
  /// mean something else ("position_in", "F_N").
  void refuse_two_units(const Column& column, std::size_t index, const std::string& unit, std::size_t line) const {
    std::string by_name = column.unit;
    const auto low_line = column.name.rfind('_');
    if (by_name.empty() && low_line != std::string::npos) by_name = column.name.substr(low_line + 1);
    if (column.unit.empty() && (by_name.size() < 2 || by_name == "in")) return;
    const auto one = find_unit(by_name), other = find_unit(unit);
    if (!one || !other || one->field != other->field || one->name == other->name) return;
    throw RecordingError(Fault::kUnits, file_, line,
                         "column " + std::to_string(index + 1) + " (" + shown_cell(column.name) + ") is in " +
                             shown_cell(by_name) + " by its name and in " + shown_cell(unit) +
                             " by this row of units; take the wrong one out");
  }

  Table bare() {
    Table table{.line = lines_[at_].number, .columns = std::vector<Column>(used_cells(lines_[at_])), .rows = {}};
    take_rows(table, nullptr, at_);
    return table;
  }

  /// Empty cells alone end a table, and before its first sure row say nothing.
  void take_rows(Table& table, const Line* names, std::size_t first) {
    const std::size_t cells = table.columns.size();
    for (; at_ < lines_.size() && (at_ < first || !is_blank(lines_[at_])); ++at_) {
      Line& line = lines_[at_];
      if (is_blank(line)) continue;
      if (names != nullptr && line.cells == names->cells) return;  // the next test, without an empty line before it
      if (line.cells.size() < cells || used_cells(line) > cells)
        throw RecordingError(Fault::kColumns, file_, line.number,
                             std::to_string(used_cells(line)) + " cells where the table has " + std::to_string(cells) +
                                 " columns (" + shown_cell(line.cells.front()) +
                                 " ...): is the line damaged, or cut? A table ends with an empty line");
      table.rows.push_back(std::move(line));
      table.rows.back().cells.resize(cells);
    }
  }

  static std::string said(const Line& line) {
    std::string text;
    for (const auto& cell : line.cells)
      if (!trimmed(cell).empty())
        text += (text.empty() ? "" : text.find(" = ") == std::string::npos ? " = " : " ") + cell;
    return base::printable(text.substr(0, 200));
  }

  std::vector<Line>& lines_;  // their cells go into the tables
  const std::filesystem::path& file_;
  std::size_t at_ = 0;
};

std::size_t decimals_of(std::string_view cell, char decimal) {
  const auto at = cell.rfind(decimal);
  return at == std::string_view::npos ? 0 : cell.size() - at - 1;
}

/// Without a line end, "44.5" may be all of the number or the beginning of "44.5250". A closed quote says that it is
/// whole, as does a column that has as many decimals in every row.
void refuse_cut(const std::string& text, const std::vector<Line>& lines, const Parsed& parsed,
                const std::filesystem::path& file) {
  if (text.empty() || text.back() == '\n' || text.back() == '\r' || parsed.tables.empty()) return;
  const Table& table = parsed.tables.back();
  if (table.rows.empty() || table.rows.back().number != lines.back().number) return;
  const Line& last = table.rows.back();
  if (last.last_cell_quoted) return;
  const std::size_t wanted = decimals_of(last.cells.back(), parsed.decimal);
  const bool fixed = wanted > 0 && table.rows.size() > 1 && std::ranges::all_of(table.rows, [&](const Line& row) {
                       return decimals_of(row.cells.back(), parsed.decimal) == wanted;
                     });
  if (!fixed)
    throw RecordingError(Fault::kTruncated, file, last.number,
                         "the last line has no line end: was the file cut off? If it is whole, end it with a line end");
}

/// The one that makes the most cells of numbers; of a long file its beginning says which, unless it has no table.
char delimiter_of(const std::string& text, std::size_t bytes, const std::filesystem::path& file,
                  const Dialect& dialect) {
  const auto end = text.find('\n', bytes);
  const std::string beginning = text.substr(0, end == std::string::npos ? end : end + 1);
  std::size_t best = 0;
  char found = ',';
  std::optional<RecordingError> damaged;
  for (const char delimiter : {';', '\t', ',', ' '}) {
    if (dialect.delimiter && *dialect.delimiter != delimiter) continue;
    try {
      if (const std::size_t cells = tabular_cells(split(beginning, delimiter, file)); cells > best) {
        best = cells;
        found = delimiter;
      }
    } catch (const RecordingError& e) {
      damaged = e;
    }
  }
  if (best == 0 && end != std::string::npos) return delimiter_of(text, text.size(), file, dialect);
  if (best == 0 && damaged) throw *damaged;
  if (best == 0)
    throw RecordingError(
        Fault::kFormat, file, 0,
        "no table of numbers is in it: two columns or more, separated by semicolons, commas, tabs or blanks");
  return found;
}

}  // namespace

Parsed parse_tables(const std::string& text, const std::filesystem::path& file, const Dialect& dialect) {
  Parsed parsed;
  constexpr std::size_t kBeginning_bytes = 1U << 18U;
  parsed.delimiter = delimiter_of(text, kBeginning_bytes, file, dialect);
  std::vector<Line> lines = split(text, parsed.delimiter, file);
  Finder(lines, file).run(parsed);
  parsed.decimal = dialect.decimal ? *dialect.decimal : decimal_of(parsed.tables, parsed.delimiter, file);
  refuse_cut(text, lines, parsed, file);
  return parsed;
}

}  // namespace isorig::foreign
