#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::messages {

/// What a cell may hold at most, as a magnitude, by what its column's name says it is. Orders of magnitude beyond any
/// machine that records so: a number outside is a damaged file, another unit or another column, and no arithmetic on
/// what is inside overflows (docs/data.md).
struct PhysicalRange {
  std::string_view suffix;  ///< of the column's name
  double most;
  std::string_view unit;
};
inline constexpr PhysicalRange kPhysicalRanges[] = {
    {"t_s", 1e10, "s"}, {"_mm", 1e4, "mm"}, {"_N", 1e6, "N"}, {"_psi", 1e3, "psi"}};
/// From row to row: a nanosecond is the finest clock there is, and a gap of more than a day is not one recording.
inline constexpr double kShortestStep_s = 1e-9, kLongestStep_s = 1e5;

/// One column of a CSV of numbers: its name in the header and where its values go.
struct CsvColumn {
  std::string_view name;
  std::vector<double>* values;
};

struct CsvColumnView {
  std::string_view name;
  std::span<const double> values;
};

/// Reads the whole file (the first column is the time) or throws RecordingError naming file and line.
/// A UTF-8 byte order mark and CR LF line ends are accepted, and further columns behind those named, whose cells are
/// counted and not read. Other names or another order are not, nor numbers outside of kPhysicalRanges.
void read_number_csv(const std::filesystem::path& file, std::span<const CsvColumn> columns);

/// Header and rows, in the shortest digits that read back the same.
[[nodiscard]] std::string number_csv_text(std::span<const CsvColumnView> columns);

/// The rules a reader would enforce, before writing: equal lengths, rows, numbers in their ranges, increasing time. Of
/// a file that is written in parts each part begins with the row before it; `first_line` is that row's in the file.
void check_columns(const std::filesystem::path& file, std::span<const CsvColumnView> columns,
                   std::size_t first_line = 2);

/// The whole file in one read.
[[nodiscard]] std::string read_whole_file(const std::filesystem::path& file);

}  // namespace isorig::messages
