#include "messages/foreign/tables.hpp"

#include <algorithm>
#include <string_view>

#include "base/printable.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {
namespace {

using Fault = messages::RecordingFault;
using messages::RecordingError;

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

bool is_blank(const Line& line) {
  return std::ranges::all_of(line.cells, [](const auto& cell) { return trimmed(cell).empty(); });
}

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

std::size_t numeric_cells(const Line& line) {
  return static_cast<std::size_t>(std::ranges::count_if(line.cells, looks_numeric));
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

/// "(mm)" or "[mm]", without its brackets; nothing for another cell.
std::optional<std::string> bracketed(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() < 2) return std::nullopt;
  const bool round = cell.front() == '(' && cell.back() == ')', square = cell.front() == '[' && cell.back() == ']';
  if (!round && !square) return std::nullopt;
  return std::string(trimmed(cell.substr(1, cell.size() - 2)));
}

/// "Time (s)" and "Kraft [N]" have their unit with them.
Column column_of(std::string_view cell) {
  cell = trimmed(cell);
  for (const auto& [open, close] : {std::pair{'(', ')'}, std::pair{'[', ']'}}) {
    const auto at = cell.rfind(open);
    if (at != std::string_view::npos && at > 0 && cell.back() == close)
      return {std::string(trimmed(cell.substr(0, at))),
              std::string(trimmed(cell.substr(at + 1, cell.size() - at - 2)))};
  }
  return {std::string(cell), {}};
}

/// Cells up to the last that is not empty: some programs end every line with a delimiter.
std::size_t used_cells(const Line& line) {
  std::size_t used = line.cells.size();
  while (used > 0 && line.cells[used - 1].empty()) --used;
  return used;
}

bool is_row(const Line& line, std::size_t cells) {
  return line.cells.size() >= cells && used_cells(line) <= cells &&
         numeric_cells(line) >= std::min<std::size_t>(cells, 2);
}

/// Names, none of them a number.
bool is_header(const Line& line) {
  return line.cells.size() >= 2 && numeric_cells(line) == 0 &&
         std::ranges::count_if(line.cells, [](const auto& c) { return !trimmed(c).empty(); }) >= 2;
}

bool is_units(const Line& line) {
  bool any = false;
  for (const auto& cell : line.cells) {
    if (trimmed(cell).empty()) continue;
    if (!bracketed(cell)) return false;
    any = true;
  }
  return any;
}

class Finder {
 public:
  Finder(std::vector<Line>& lines, const std::filesystem::path& file) : lines_(lines), file_(file) {}

  void run(Parsed& parsed) {
    while (at_ < lines_.size()) {
      const Line& line = lines_[at_];
      const std::size_t units = at_ + 1 < lines_.size() && is_units(lines_[at_ + 1]) ? 1 : 0;
      const bool begins = at_ + 1 + units < lines_.size();
      if (is_header(line) && !is_units(line) && begins && is_row(lines_[at_ + 1 + units], used_cells(line))) {
        parsed.tables.push_back(headed(units));
      } else if (is_header(line) && !is_units(line) && units == 1) {
        throw RecordingError(
            Fault::kTruncated, file_, line.number + 1 + units,
            "a table of " + std::to_string(used_cells(line)) + " columns has no row of as many numbers");
      } else if (used_cells(line) >= 2 && numeric_cells(line) == used_cells(line)) {
        if (!parsed.tables.empty())
          throw RecordingError(Fault::kColumns, file_, line.number,
                               "rows without a header behind an empty line: is something missing here? Take the empty "
                               "line out if they belong together, or put each test into a file of its own");
        parsed.tables.push_back(bare());
      } else if (begins && is_header(line) && !is_units(line) && numeric_cells(lines_[at_ + 1]) >= used_cells(line)) {
        refuse_rows(lines_[at_ + 1], used_cells(line));
      } else if (!parsed.tables.empty() && numeric_cells(line) >= 2) {
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

  Table headed(std::size_t units) {
    const Line& names = lines_[at_];
    Table table{.line = names.number, .columns = {}, .rows = {}};
    for (std::size_t c = 0; c < used_cells(names); ++c) table.columns.push_back(column_of(names.cells[c]));
    if (units == 1) {
      const Line& line = lines_[at_ + 1];
      if (line.cells.size() < table.columns.size() || used_cells(line) > table.columns.size())
        throw RecordingError(
            Fault::kColumns, file_, line.number,
            std::to_string(used_cells(line)) + " units for " + std::to_string(table.columns.size()) + " columns");
      for (std::size_t c = 0; c < table.columns.size(); ++c)
        if (const auto unit = bracketed(line.cells[c])) table.columns[c].unit = *unit;
    }
    at_ += 1 + units;
    take_rows(table, &names);
    return table;
  }

  Table bare() {
    Table table{.line = lines_[at_].number, .columns = std::vector<Column>(used_cells(lines_[at_])), .rows = {}};
    take_rows(table, nullptr);
    return table;
  }

  void take_rows(Table& table, const Line* names) {
    const std::size_t cells = table.columns.size();
    for (; at_ < lines_.size() && !is_blank(lines_[at_]); ++at_) {
      Line& line = lines_[at_];
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
