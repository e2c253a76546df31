#include "messages/csv.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <system_error>

#include "base/number_text.hpp"
#include "base/text_file.hpp"
#include "messages/recording.hpp"

namespace isorig::messages {
namespace {

using Fault = RecordingFault;

template <typename Column>
std::string header_text(std::span<const Column> columns) {
  std::string text;
  for (const auto& column : columns) {
    if (!text.empty()) text += ',';
    text += column.name;
  }
  return text;
}

/// A cell for an error message: short, and without what would upset a terminal.
std::string quoted(std::string_view cell) {
  std::string out = "\"";
  for (const char c : cell.substr(0, 40)) out += (c >= ' ' && c <= '~') ? c : '?';
  return out + (cell.size() > 40 ? "...\"" : "\"");
}

std::string_view trimmed(std::string_view cell) {
  const auto first = cell.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return cell.substr(first, cell.find_last_not_of(" \t") - first + 1);
}

/// Null: of a column that no range is known for.
const PhysicalRange* range_of(std::string_view column) {
  const auto* found = std::find_if(std::begin(kPhysicalRanges), std::end(kPhysicalRanges),
                                   [&](const PhysicalRange& r) { return column.ends_with(r.suffix); });
  return found == std::end(kPhysicalRanges) ? nullptr : found;
}

double most_of(std::string_view column) {
  const auto* range = range_of(column);
  return range == nullptr ? std::numeric_limits<double>::max() : range->most;
}

/// Nine digits: time stamps are seconds with nanoseconds.
std::string shown(double value) {
  return base::number_text(value, 9);
}

/// "`force_N` is 1e+300; it lies between -1e+06 and 1e+06 N: ..."
std::string out_of_range(std::string_view column, double value) {
  const auto& range = *range_of(column);
  const std::string unit(range.unit);
  return "`" + std::string(column) + "` is " + shown(value) + "; it lies between " + shown(-range.most) + " and " +
         shown(range.most) + " " + unit + ": is the line damaged, or the column in another unit?";
}

/// What is wrong with the step from one row's time to the next; "" when nothing is.
std::string wrong_step(double before_s, double now_s) {
  const double step_s = now_s - before_s;
  if (step_s >= kShortestStep_s && step_s <= kLongestStep_s) return {};
  const std::string both = shown(now_s) + " s after " + shown(before_s) + " s";
  if (step_s == 0.0) return "time stands still: " + both + "; every row has to be later than the one before";
  if (step_s < 0.0) return "time runs backwards: " + both + "; every row has to be later than the one before";
  if (step_s < kShortestStep_s) {
    return "time moves by " + shown(step_s) + " s: " + both + "; no clock is finer than " + shown(kShortestStep_s) +
           " s, so the time is damaged or in another unit";
  }
  return "a gap of " + shown(step_s) + " s: " + both + "; more than " + shown(kLongestStep_s) +
         " s do not belong to one recording: cut it there, or is the time in another unit?";
}

class Reader {
 public:
  Reader(const std::filesystem::path& file, std::span<const CsvColumn> columns)
      : file_(file), columns_(columns), text_(read_whole_file(file)) {
    for (const auto& column : columns_) most_.push_back(most_of(column.name));
  }

  void run() {
    const char* p = read_header();
    cells_ = columns_.size() + further_;
    const char* const end = text_.data() + text_.size();
    const auto rows = static_cast<std::size_t>(std::count(p, end, '\n')) + 1;
    for (const auto& column : columns_) {
      column.values->clear();
      column.values->reserve(rows);
    }
    row_.resize(columns_.size());
    while (p != end) {
      ++line_;
      const char* next = parse_row(p, end);
      if (next == nullptr) next = parse_row_carefully(p, end);
      for (std::size_t c = 0; c < row_.size(); ++c) {
        if (!(std::abs(row_[c]) <= most_[c])) fail(Fault::kRange, line_, out_of_range(columns_[c].name, row_[c]));
      }
      const auto& time = *columns_[0].values;
      if (!time.empty()) {
        if (const auto wrong = wrong_step(time.back(), row_[0]); !wrong.empty()) fail(Fault::kTime, line_, wrong);
      }
      for (std::size_t c = 0; c < row_.size(); ++c) columns_[c].values->push_back(row_[c]);
      p = next;
    }
    if (columns_[0].values->empty()) fail(Fault::kEmpty, line_ + 1, "no rows below the header");
  }

 private:
  [[noreturn]] void fail(Fault fault, std::size_t line, const std::string& message) const {
    throw RecordingError(fault, file_, line, message);
  }

  const char* read_header() {
    std::string_view rest = text_;
    if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
    const std::string expected = header_text(columns_);
    if (rest.empty()) fail(Fault::kEmpty, 1, "the file is empty; it has to begin with `" + expected + "`");
    const auto length = std::min(rest.find('\n'), rest.size());
    std::string_view header = rest.substr(0, length);
    if (header.ends_with('\r')) header.remove_suffix(1);
    line_ = 1;
    const bool further =
        header.size() > expected.size() && header.starts_with(expected) && header[expected.size()] == ',';
    if (further) {
      check_further(header.substr(expected.size() + 1));
    } else if (header != expected) {
      std::string message = "the header is " + quoted(header) + "; expected `" + expected + "`, then whatever else";
      for (const auto& column : columns_) {
        if (!has_cell(header, column.name)) message += "; column `" + std::string(column.name) + "` is missing";
      }
      fail(Fault::kHeader, 1, message);
    }
    return length == rest.size() ? rest.data() + length : rest.data() + length + 1;
  }

  /// Columns behind those that are read. Which they are is their writer's business, but each has a name of its own:
  /// otherwise the header is damaged, or the line no header.
  void check_further(std::string_view names) {
    std::vector<std::string_view> seen;
    for (const auto& column : columns_) seen.push_back(column.name);
    while (true) {
      const auto comma = names.find(',');
      const auto name = trimmed(names.substr(0, comma));
      if (name.empty()) fail(Fault::kHeader, 1, "the header has a further column without a name");
      if (std::find(seen.begin(), seen.end(), name) != seen.end()) {
        fail(Fault::kHeader, 1, "the header names the column " + quoted(name) + " twice");
      }
      seen.push_back(name);
      ++further_;
      if (comma == std::string_view::npos) return;
      names.remove_prefix(comma + 1);
    }
  }

  static bool has_cell(std::string_view line, std::string_view name) {
    while (true) {
      const auto comma = line.find(',');
      if (line.substr(0, comma) == name) return true;
      if (comma == std::string_view::npos) return false;
      line.remove_prefix(comma + 1);
    }
  }

  /// A well-formed row into row_; null when anything at all is unusual.
  const char* parse_row(const char* p, const char* end) {
    for (std::size_t c = 0; c < row_.size(); ++c) {
      const auto [stop, error] = std::from_chars(p, end, row_[c]);
      if (error != std::errc{} || stop == end || !std::isfinite(row_[c])) return nullptr;
      if (c + 1 < cells_) {
        if (*stop != ',') return nullptr;
        if (c + 1 == row_.size()) return skip_further(stop, end);
      } else if (*stop == '\r' && stop + 1 != end && stop[1] == '\n') {
        return stop + 2;
      } else if (*stop != '\n') {
        return nullptr;
      }
      p = stop + 1;
    }
    return nullptr;
  }

  /// Past the cells of the further columns, from the comma before them; null when there are not as many as there
  /// should.
  const char* skip_further(const char* p, const char* end) const {
    const auto* stop = static_cast<const char*>(std::memchr(p, '\n', static_cast<std::size_t>(end - p)));
    if (stop == nullptr || static_cast<std::size_t>(std::count(p, stop, ',')) != further_) return nullptr;
    return stop + 1;
  }

  /// The same with blanks and a plus sign allowed round the numbers; throws what is wrong.
  const char* parse_row_carefully(const char* p, const char* end) {
    const void* newline = std::memchr(p, '\n', static_cast<std::size_t>(end - p));
    const char* stop = newline == nullptr ? end : static_cast<const char*>(newline);
    std::string_view line(p, static_cast<std::size_t>(stop - p));
    if (line.ends_with('\r')) line.remove_suffix(1);
    const auto cells = static_cast<std::size_t>(std::count(line.begin(), line.end(), ',')) + 1;
    if (newline == nullptr && (cells < cells_ || !last_line_is_whole(line))) {
      fail(Fault::kTruncated, line_,
           "the last line " + quoted(line) + " has no line end, so it may have been cut off; the recording was " +
               "interrupted, or, if the line is whole, end it with a newline");
    }
    if (trimmed(line).empty()) fail(Fault::kColumns, line_, "an empty line; remove it");
    if (cells != cells_) {
      fail(Fault::kColumns, line_,
           std::to_string(cells) + " cells, expected " + std::to_string(cells_) + " (`" + header_text(columns_) +
               (further_ > 0 ? ",...`)" : "`)"));
    }
    for (std::size_t c = 0; c < row_.size(); ++c) {
      const auto comma = std::min(line.find(','), line.size());
      row_[c] = number(trimmed(line.substr(0, comma)), columns_[c].name);
      line.remove_prefix(std::min(comma + 1, line.size()));
    }
    return newline == nullptr ? end : stop + 1;
  }

  double number(std::string_view cell, std::string_view name) const {
    std::string_view digits = cell;
    if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
    double value = 0.0;
    const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    const bool whole = stop == digits.data() + digits.size() && !digits.empty();
    if (error == std::errc::invalid_argument || !whole) {
      fail(Fault::kNotNumber, line_, "`" + std::string(name) + "` is " + quoted(cell) + "; a number is needed");
    }
    if (error != std::errc{} || !std::isfinite(value)) {
      fail(Fault::kNotFinite, line_, "`" + std::string(name) + "` is " + quoted(cell) + "; a finite number is needed");
    }
    return value;
  }

  /// Without a line end, "44.5" may be all of the number or the beginning of "44.5250". Only a column written
  /// with a fixed number of decimals tells: then the line is whole when it has as many as all others.
  bool last_line_is_whole(std::string_view last) const {
    const auto wanted = decimals(last);
    if (wanted == 0 || line_ < 3) return false;
    std::string_view rest(text_);
    rest.remove_prefix(rest.find('\n') + 1);
    while (rest.data() != last.data()) {
      const auto length = rest.find('\n');
      std::string_view line = rest.substr(0, length);
      if (line.ends_with('\r')) line.remove_suffix(1);
      if (decimals(line) != wanted) return false;
      rest.remove_prefix(length + 1);
    }
    return true;
  }

  /// Digits behind the last cell's point; 0 when it has none or is in exponent form.
  static std::size_t decimals(std::string_view line) {
    const auto point = line.rfind('.');
    if (point == std::string_view::npos) return 0;
    const auto digits = line.substr(point + 1);
    return digits.find_first_not_of("0123456789") == std::string_view::npos ? digits.size() : 0;
  }

  const std::filesystem::path& file_;
  std::span<const CsvColumn> columns_;
  std::string text_;
  std::vector<double> row_, most_;
  std::size_t line_ = 0;
  std::size_t further_ = 0;  ///< columns behind those that are read
  std::size_t cells_ = 0;
};

}  // namespace

std::string read_whole_file(const std::filesystem::path& file) {
  try {
    return base::read_text_file(file);
  } catch (const base::FileError& e) {
    if (e.missing()) throw RecordingError(Fault::kMissingFile, file, 0, "no such file");
    throw RecordingError(Fault::kUnreadable, file, 0, e.reason());
  }
}

void read_number_csv(const std::filesystem::path& file, std::span<const CsvColumn> columns) {
  Reader(file, columns).run();
}

void check_columns(const std::filesystem::path& file, std::span<const CsvColumnView> columns, std::size_t first_line) {
  const auto time = columns[0].values;
  if (time.empty()) throw RecordingError(Fault::kInconsistent, file, 0, "not written: no rows");
  for (const auto& column : columns) {
    const std::string name = "`" + std::string(column.name) + "`";
    if (column.values.size() != time.size()) {
      throw RecordingError(Fault::kInconsistent, file, 0,
                           "not written: " + name + " has " + std::to_string(column.values.size()) + " rows, `" +
                               std::string(columns[0].name) + "` has " + std::to_string(time.size()));
    }
    const double most = most_of(column.name);
    for (std::size_t i = 0; i < time.size(); ++i) {
      if (!std::isfinite(column.values[i])) {
        throw RecordingError(Fault::kInconsistent, file, i + first_line, "not written: " + name + " is not finite");
      }
      if (std::abs(column.values[i]) > most) {
        throw RecordingError(Fault::kInconsistent, file, i + first_line,
                             "not written: " + out_of_range(column.name, column.values[i]));
      }
    }
  }
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (!(time[i] > time[i - 1])) {
      throw RecordingError(Fault::kInconsistent, file, i + first_line, "not written: time does not increase");
    }
    if (const auto wrong = wrong_step(time[i - 1], time[i]); !wrong.empty()) {
      throw RecordingError(Fault::kInconsistent, file, i + first_line, "not written: " + wrong);
    }
  }
}

std::string number_csv_text(std::span<const CsvColumnView> columns) {
  std::string text = header_text(columns) + '\n';
  const std::size_t rows = columns[0].values.size();
  text.reserve(text.size() + rows * columns.size() * 12);
  char digits[32];
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const auto end = std::to_chars(digits, digits + sizeof digits, columns[c].values[i]).ptr;
      text.append(digits, end);
      text += c + 1 < columns.size() ? ',' : '\n';
    }
  }
  return text;
}

}  // namespace isorig::messages
