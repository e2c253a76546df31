#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

/// What an export is made of, whatever file it becomes: tables of named columns with their units and where they come
/// from. The writers (writer.hpp) only put these into a format.
namespace isorig::daemon {

/// How a column's cells are kept. kFlag, kSmall and kWhole are integers of 8, 32 and 64 bits where a format tells them
/// apart.
enum class ColumnType : std::uint8_t { kReal, kFlag, kSmall, kWhole, kText };

using Attribute = std::variant<std::string, double, std::int64_t>;
using Attributes = std::vector<std::pair<std::string, Attribute>>;

/// Numbers of a kReal column are rounded to `decimals` when they come in, so that every format holds the same double:
/// the one nearest to that decimal number. NaN where there is nothing to say (an empty cell of a CSV).
struct Column {
  std::string name;  ///< ends with its unit: position_mm
  ColumnType type = ColumnType::kReal;
  std::string unit;  ///< "" of what has none
  std::string description;
  int decimals = 9;
  Attributes attributes{};  ///< resolution, calibration
};

/// A key of a TOML file as the name of an attribute: a field of a MAT struct has only letters, digits and '_'.
[[nodiscard]] std::string attribute_name(std::string key);

struct TableSchema {
  std::string name;
  std::string description;
  std::vector<Column> columns;
  Attributes attributes{};  ///< source device, clock
};

struct Cells {
  std::vector<double> real;
  std::vector<std::int64_t> whole;
  std::vector<std::string> text;
};

/// `value` as it is written with so many decimals. Beyond 2^53 units of the last decimal nothing is rounded.
[[nodiscard]] double rounded(double value, int decimals) noexcept;
/// So many decimals that rounding moves a value by at most a twentieth of `resolution`; 9 for none (0 or less).
[[nodiscard]] int decimals_for(double resolution) noexcept;

/// Whole, or as a block of a stream that is longer than memory.
class Table {
 public:
  explicit Table(TableSchema schema) : schema_(std::move(schema)), cells_(schema_.columns.size()) {}

  [[nodiscard]] const TableSchema& schema() const noexcept { return schema_; }
  [[nodiscard]] const std::vector<Cells>& cells() const noexcept { return cells_; }
  [[nodiscard]] std::size_t rows() const noexcept { return rows_; }

  /// The cells of a row in the order of the columns, then end_row(), which throws std::logic_error when they are not as
  /// many as there are columns.
  Table& real(double value);
  Table& whole(std::int64_t value);
  Table& text(std::string value);
  void end_row();
  void clear();  ///< the cells

 private:
  TableSchema schema_;
  std::vector<Cells> cells_;
  std::size_t rows_ = 0, at_ = 0;
};

}  // namespace isorig::daemon
