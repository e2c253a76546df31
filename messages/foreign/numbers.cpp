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

std::optional<double> clock_s(std::string_view cell) {
  // The time begins with the digits in front of its first colon; a date stands before them.
  const auto colon = cell.find(':');
  if (colon == std::string_view::npos || colon == 0) return std::nullopt;
  const auto before = cell.substr(0, colon).find_last_not_of("0123456789");
  const std::string_view date = before == std::string_view::npos ? "" : cell.substr(0, before + 1);
  if (date.find_first_not_of("0123456789-./T ") != std::string_view::npos) return std::nullopt;
  if (!date.empty() && date.back() != 'T' && date.back() != ' ') return std::nullopt;
  std::string_view rest = cell.substr(date.size());
  const auto digits = [&rest] {
    const auto n = std::min(rest.find_first_not_of("0123456789"), rest.size());
    const std::string_view taken = rest.substr(0, n);
    rest.remove_prefix(n);
    return taken;
  };
  std::vector<int> parts;
  do {
    if (!parts.empty()) rest.remove_prefix(1);
    const std::string_view part = digits();
    if (part.empty() || part.size() > 2 || parts.size() == 3) return std::nullopt;
    parts.push_back(std::stoi(std::string(part)));
  } while (rest.starts_with(':'));
  std::string fraction;
  if (rest.starts_with('.') || rest.starts_with(',')) {
    rest.remove_prefix(1);
    fraction = digits();
    if (fraction.empty() || fraction.size() > 15) return std::nullopt;
  }
  const std::string_view suffix = rest.substr(std::min(rest.find_first_not_of(' '), rest.size()));
  const bool pm = suffix == "PM" || suffix == "pm", am = suffix == "AM" || suffix == "am";
  if (!suffix.empty() && suffix != "Z" && !pm && !am) return std::nullopt;
  if (parts.size() < 2) return std::nullopt;
  if (parts.size() == 2) {  // without a fraction these may be hours and minutes
    if (fraction.empty() || !suffix.empty() || !date.empty()) return std::nullopt;
    parts.insert(parts.begin(), 0);
  }
  if (parts[0] > (pm || am ? 12 : 23) || parts[1] > 59 || parts[2] > 59) return std::nullopt;
  if (pm || am) parts[0] = parts[0] % 12 + (pm ? 12 : 0);
  // As one number: 36015 + 0.37 is not always 36015.37.
  return std::stod(std::to_string(3600 * parts[0] + 60 * parts[1] + parts[2]) + '.' + fraction);
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
