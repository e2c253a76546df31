#include "messages/foreign/heads.hpp"

#include <algorithm>

#include "messages/foreign/column_names.hpp"
#include "messages/foreign/mapping.hpp"

namespace isorig::foreign {
namespace {

std::string_view without_sign(std::string_view cell) {
  cell = trimmed(cell);
  if (!cell.empty() && (cell.front() == '-' || cell.front() == '+')) cell.remove_prefix(1);
  return cell;
}

bool is_no_number(std::string_view cell) {
  const std::string text = small(without_sign(cell));
  return text == "inf" || text == "infinity" || text.starts_with("1.#") || says_no_value(cell);
}

/// "-", "-----": likewise, or below a name that it has no unit.
bool is_dashes(std::string_view cell) {
  cell = trimmed(cell);
  return !cell.empty() && cell.find_first_not_of('-') == std::string_view::npos;
}

bool is_word(std::string_view cell) {
  return !trimmed(cell).empty() && !looks_numeric(cell) && !is_no_number(cell) && !is_dashes(cell);
}

bool fits(const Line& line, std::size_t cells) {
  return line.cells.size() >= cells && used_cells(line) <= cells;
}

/// Whether no word of the line stands where the row has a number.
bool is_like(const Line& line, const Line& row) {
  const std::size_t cells = std::min(line.cells.size(), row.cells.size());
  for (std::size_t c = 0; c < cells; ++c)
    if (is_word(line.cells[c]) && looks_numeric(row.cells[c])) return false;
  return true;
}

/// Two of them mean something: words of five languages, units in brackets.
bool is_telling(const Line& names) {
  return std::ranges::count_if(names.cells, [](const auto& cell) {
           const Column column = column_of(cell);
           return named(column.name) || find_unit(column.unit);
         }) >= 2;
}

}  // namespace

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

bool says_no_value(std::string_view cell) {
  // C, MATLAB, Python, R, databases, and Excel in English and German.
  constexpr std::string_view kWords[] = {"N/A",   "n/a",    "NA",      "NULL", "null",   "#N/A",  "#DIV/0!",
                                         "#NUM!", "#NULL!", "#VALUE!", "#NV",  "#ZAHL!", "#WERT!"};
  if (std::ranges::find(kWords, trimmed(cell)) != std::end(kWords)) return true;
  const std::string text = small(without_sign(cell));
  return text == "nan" || text.starts_with("nan(");
}

bool is_blank(const Line& line) {
  return std::ranges::all_of(line.cells, [](const auto& cell) { return trimmed(cell).empty(); });
}

std::size_t used_cells(const Line& line) {
  std::size_t used = line.cells.size();
  while (used > 0 && line.cells[used - 1].empty()) --used;
  return used;
}

std::size_t numeric_cells(const Line& line) {
  return static_cast<std::size_t>(std::ranges::count_if(line.cells, looks_numeric));
}

bool is_names(const Line& line) {
  return line.cells.size() >= 2 && numeric_cells(line) == 0 && std::ranges::count_if(line.cells, is_word) >= 2 &&
         std::ranges::none_of(line.cells, is_no_number);
}

bool is_row(const Line& line, std::size_t cells) {
  if (!fits(line, cells)) return false;
  const std::size_t numbers = numeric_cells(line);
  if (numbers >= std::min<std::size_t>(cells, 2)) return true;
  const auto none = static_cast<std::size_t>(std::ranges::count_if(line.cells, is_no_number));
  return numbers > 0 && none > 0 && numbers + none == cells;
}

std::optional<std::string> bracketed(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() < 2) return std::nullopt;
  const bool round = cell.front() == '(' && cell.back() == ')', square = cell.front() == '[' && cell.back() == ']';
  if (!round && !square) return std::nullopt;
  return std::string(trimmed(cell.substr(1, cell.size() - 2)));
}

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

bool is_bracketed_units(const Line& line) {
  bool any = false;
  for (const auto& cell : line.cells) {
    if (trimmed(cell).empty()) continue;
    if (!bracketed(cell)) return false;
    any = true;
  }
  return any;
}

bool is_units(const Line& names, const Line& line) {
  if (is_bracketed_units(line)) return true;
  std::size_t all = 0, known = 0, dashes = 0;
  bool asked_for = false;
  for (std::size_t c = 0; c < line.cells.size(); ++c) {
    const std::string_view cell = trimmed(line.cells[c]);
    if (cell.empty()) continue;
    ++all;
    if (is_dashes(cell)) {
      ++dashes;
      continue;
    }
    const auto text = bracketed(cell);
    const auto unit = find_unit(text ? std::string_view(*text) : cell);
    if (unit || text) {
      ++known;
      const auto word = c < names.cells.size() ? named(column_of(names.cells[c]).name) : std::nullopt;
      asked_for = asked_for || (unit && word && word->field == unit->field);
    } else if (looks_numeric(cell) || is_no_number(cell) || named(std::string(cell))) {
      return false;
    }
  }
  return known > 0 && (asked_for || 2 * (known + dashes) > all);
}

std::optional<Head> head_at(const std::vector<Line>& lines, std::size_t at) {
  const Line& names = lines[at];
  if (!is_names(names) || is_bracketed_units(names)) return std::nullopt;
  Head head;
  if (at + 1 < lines.size() && is_units(names, lines[at + 1])) head.units = 1;
  const std::size_t below = at + 1 + head.units, cells = used_cells(names);
  for (head.first = below; head.first < lines.size(); ++head.first) {
    const Line& line = lines[head.first];
    if (is_row(line, cells)) break;
    if (!fits(line, cells) || is_names(line)) return std::nullopt;
  }
  if (head.first == lines.size()) return std::nullopt;
  const bool sure = head.units > 0 || is_telling(names);
  for (std::size_t before = below; before < head.first && !sure; ++before)
    if (!is_like(lines[before], lines[head.first])) return std::nullopt;
  return head;
}

std::optional<std::size_t> wider_row_below(const std::vector<Line>& lines, std::size_t at) {
  const Line& names = lines[at];
  if (!is_names(names) || is_bracketed_units(names)) return std::nullopt;
  const std::size_t cells = used_cells(names);
  const std::size_t below = at + 1 + (at + 1 < lines.size() && is_units(names, lines[at + 1]) ? 1 : 0);
  std::size_t row = below;
  while (row < lines.size() && used_cells(lines[row]) > cells && !is_names(lines[row]) &&
         numeric_cells(lines[row]) < cells)
    ++row;
  if (row == lines.size() || numeric_cells(lines[row]) < cells) return std::nullopt;
  for (std::size_t before = below; before < row; ++before)
    if (!is_like(lines[before], lines[row])) return std::nullopt;
  return below;
}

}  // namespace isorig::foreign
