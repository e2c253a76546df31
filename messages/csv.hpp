#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::messages {

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
/// A UTF-8 byte order mark and CR LF line ends are accepted; other names, orders or numbers of columns are
/// not.
void read_number_csv(const std::filesystem::path& file, std::span<const CsvColumn> columns);

/// Header and rows, in the shortest digits that read back the same.
[[nodiscard]] std::string number_csv_text(std::span<const CsvColumnView> columns);

/// The rules a reader would enforce, before writing: equal lengths, rows, finite numbers, increasing time.
void check_columns(const std::filesystem::path& file, std::span<const CsvColumnView> columns);

/// The whole file in one read.
[[nodiscard]] std::string read_whole_file(const std::filesystem::path& file);

}  // namespace isorig::messages
