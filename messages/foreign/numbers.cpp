#include <algorithm>
#include <charconv>
#include <cmath>

#include "messages/foreign/tables.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {
namespace {

using Fault = messages::RecordingFault;
using messages::RecordingError;

/// "1,234" and "1.234" may be thousands or decimals.
bool may_group_thousands(std::string_view cell, char mark) {
  if (!cell.empty() && (cell.front() == '-' || cell.front() == '+')) cell.remove_prefix(1);
  const auto first = cell.find(mark);
  if (first == std::string_view::npos || first == 0 || first > 3 || cell.front() == '0') return false;
  if (!std::ranges::all_of(cell, [&](char c) { return (c >= '0' && c <= '9') || c == mark; })) return false;
  for (std::size_t at = first; at < cell.size(); at += 4)
    if (cell[at] != mark || at + 4 > cell.size()) return false;
  return true;
}

}  // namespace

bool looks_numeric(std::string_view cell) {
  return number_of(cell, '.').has_value() || number_of(cell, ',').has_value();
}

char decimal_of(const std::vector<Table>& tables, char delimiter, const std::filesystem::path& file) {
  bool point = false, comma = false;
  const Line* doubtful = nullptr;
  for (const Table& table : tables) {
    for (const Line& line : table.rows) {
      for (const auto& cell : line.cells) {
        if (!looks_numeric(cell)) continue;
        const auto at_point = cell.rfind('.'), at_comma = cell.rfind(',');
        if (at_point != std::string::npos && at_comma != std::string::npos) {
          (at_point > at_comma ? point : comma) = true;
        } else if (at_point != std::string::npos) {
          // Points that group thousands come with decimal commas, and those with semicolons between the columns.
          if (delimiter == ';' && may_group_thousands(cell, '.')) {
            doubtful = &line;
          } else {
            (std::ranges::count(cell, '.') == 1 ? point : comma) = true;
          }
        } else if (at_comma != std::string::npos) {
          if (may_group_thousands(cell, ',')) {
            doubtful = &line;
          } else {
            (std::ranges::count(cell, ',') == 1 ? comma : point) = true;
          }
        }
      }
    }
  }
  if (point && comma)
    throw RecordingError(
        Fault::kFormat, file, 0,
        "some numbers have a decimal point and some a decimal comma; say which it is: --decimal . or --decimal ,");
  if (!point && !comma && doubtful != nullptr)
    throw RecordingError(Fault::kFormat, file, doubtful->number,
                         "numbers like these may have decimals or thousands; say which mark the decimals have: "
                         "--decimal . or --decimal ,");
  return comma ? ',' : '.';
}

std::optional<double> number_of(std::string_view cell, char decimal) {
  const char grouping = decimal == '.' ? ',' : '.';
  std::string digits;
  std::size_t since_group = 0;
  bool grouped = false, fraction = false;
  const auto closes_group = [&] { return !grouped || since_group == 3; };
  for (std::size_t i = 0; i < cell.size(); ++i) {
    const char c = cell[i];
    const bool narrow = cell.substr(i).starts_with("\xE2\x80\xAF"), no_break = cell.substr(i).starts_with("\xC2\xA0");
    if (c >= '0' && c <= '9') {
      digits += c;
      if (!fraction) ++since_group;
    } else if (c == decimal && !fraction) {
      if (!closes_group()) return std::nullopt;
      digits += '.';
      fraction = true;
    } else if (!fraction && i > 0 && (c == grouping || c == '\'' || c == ' ' || narrow || no_break)) {
      if (since_group == 0 || since_group > 3 || !closes_group()) return std::nullopt;
      grouped = true;
      since_group = 0;
      i += narrow ? 2 : no_break ? 1 : 0;
    } else if ((c == 'e' || c == 'E') && !digits.empty() && digits.find('e') == std::string::npos && closes_group()) {
      digits += 'e';
      fraction = true;
    } else if (c == '-' && (digits.empty() || digits.back() == 'e')) {
      digits += c;
    } else if (c == '+' && (i == 0 || (!digits.empty() && digits.back() == 'e'))) {
      continue;
    } else {
      return std::nullopt;
    }
  }
  if (!closes_group() || digits.empty()) return std::nullopt;
  double value = 0.0;
  const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc{} || stop != digits.data() + digits.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace isorig::foreign
