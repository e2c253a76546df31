#include "messages/further_columns.hpp"

#include <string_view>

#include "messages/csv.hpp"

namespace isorig::messages {
namespace {

/// The next line, without its end; takes it off `rest`.
std::string_view next_line(std::string_view& rest) {
  const auto end = rest.find('\n');
  std::string_view line = rest.substr(0, end);
  rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  while (true) {
    const auto comma = line.find(',');
    std::string_view cell = line.substr(0, comma);
    const auto first = cell.find_first_not_of(" \t");
    cell = first == std::string_view::npos ? std::string_view{}
                                           : cell.substr(first, cell.find_last_not_of(" \t") - first + 1);
    cells.push_back(cell);
    if (comma == std::string_view::npos) return cells;
    line.remove_prefix(comma + 1);
  }
}

}  // namespace

std::vector<FurtherColumn> read_further_columns(const std::filesystem::path& file, std::size_t own) {
  const std::string text = read_whole_file(file);
  std::string_view rest = text;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  std::vector<FurtherColumn> out;
  const auto names = cells_of(next_line(rest));
  for (std::size_t c = own; c < names.size(); ++c) out.push_back({std::string(names[c]), {}});
  if (out.empty()) return out;
  for (std::size_t line = 2; !rest.empty(); ++line) {
    const auto cells = cells_of(next_line(rest));
    if (cells.size() != names.size())
      throw RecordingError(RecordingFault::kColumns, file, line,
                           std::to_string(cells.size()) + " cells, expected " + std::to_string(names.size()));
    for (std::size_t c = own; c < cells.size(); ++c) out[c - own].cells.emplace_back(cells[c]);
  }
  return out;
}

std::string with_further_columns(const std::string& csv, std::span<const FurtherColumn> further) {
  if (further.empty()) return csv;
  std::string text;
  std::string_view rest = csv;
  const auto put = [&](auto cell_of) {
    text += next_line(rest);
    for (const auto& column : further) (text += ',') += cell_of(column);
    text += '\n';
  };
  put([](const FurtherColumn& column) { return std::string_view(column.name); });
  for (std::size_t row = 0; !rest.empty(); ++row)
    put([row](const FurtherColumn& column) { return std::string_view(column.cells.at(row)); });
  return text;
}

}  // namespace isorig::messages
