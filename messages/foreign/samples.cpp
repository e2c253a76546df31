#include "messages/foreign/samples.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "messages/csv.hpp"
#include "messages/foreign/heads.hpp"

namespace isorig::foreign {
namespace {

/// By a thousandth or a millionth it is divided by the whole number: 1e-6 is no exact double, and 4294020000 us came
/// out as 4294.0199999999995 s.
double times(double factor, double number) {
  const double parts = std::round(1.0 / factor);
  return factor < 1.0 && parts * factor == 1.0 ? number / parts : factor * number;
}

using Fault = messages::RecordingFault;
using messages::RecordingError;

const Source* source_of(const std::vector<Source>& sources, Field field) {
  const auto found = std::ranges::find(sources, field, &Source::field);
  return found == sources.end() ? nullptr : &*found;
}

std::string said(double value, std::string_view unit) {
  return base::number_text(value, 9) + " " + std::string(unit);
}

/// Columns that the export gives a meaning to (docs/formats/recording.md); another program's are something else.
constexpr std::string_view kOfTheExport[] = {
    "t_s",         "position_mm", "force_N",          "pressure_psi",     "position_min_mm", "position_max_mm",
    "force_min_N", "force_max_N", "pressure_min_psi", "pressure_max_psi", "averaged",        "samples",
    "step",        "mono_ns",     "bound_ns",         "repeatability_ns", "device_us",       "sequence"};

/// Letters of Latin-1 without their marks, other signs as their usual names, all else "_".
std::string ascii_of(std::string_view text) {
  constexpr std::string_view kLatin =
      "AAAAAAACEEEEIIIIDNOOOOOxOUUUUYTsaaaaaaaceeeeiiiidnooooo_ouuuuyty";  // U+00C0 to U+00FF
  constexpr std::pair<std::string_view, std::string_view> kSigns[] = {{"\xC2\xB0", ""},        {"\xC2\xB5", "u"},
                                                                      {"\xCE\xBC", "u"},       {"\xCE\xA9", "ohm"},
                                                                      {"\xE2\x84\xA6", "ohm"}, {"%", "percent"}};
  std::string out;
  while (!text.empty()) {
    const auto* sign = std::ranges::find_if(kSigns, [&](const auto& s) { return text.starts_with(s.first); });
    const char c = text[0];
    if (sign != std::end(kSigns)) {
      out += sign->second;
      text.remove_prefix(sign->first.size());
      continue;
    }
    if (c == '\xC3' && text.size() > 1 && (static_cast<unsigned char>(text[1]) & 0xC0U) == 0x80U) {
      out += kLatin[static_cast<unsigned char>(text[1]) & 0x3FU];
      text.remove_prefix(2);
      continue;
    }
    const bool plain = (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
    if (plain)
      out += c;
    else if (!out.empty() && out.back() != '_')
      out += '_';
    text.remove_prefix(1);
  }
  while (out.ends_with('_')) out.pop_back();
  return out;
}

/// "Temperature (C)" is temperature_C. What a file calls by one name twice, or as the export calls something else, gets
/// a number behind it. `last` has every name that is taken and its last number: a header of thousands of equal names is
/// not searched for each.
std::string further_name(const Column& column, std::size_t index, std::map<std::string, int>& last) {
  std::string name = ascii_of(column.name);
  const std::string unit = ascii_of(column.unit);
  if (name.empty()) name = "column_" + std::to_string(index + 1);
  if (!unit.empty()) {
    for (char& c : name)
      if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    name += '_' + unit;
  }
  std::string free = name;
  while (!last.try_emplace(free, 1).second) free = name + '_' + std::to_string(++last[name]);
  return free;
}

/// Cells of numbers, empty where the file has none ("", "NaN"); nothing where one is neither, or all are empty.
std::optional<std::vector<std::string>> number_cells(const Table& table, std::size_t index, char decimal) {
  std::vector<std::string> cells;
  bool any = false;
  for (const Line& row : table.rows) {
    const std::string& cell = row.cells[index];
    const auto value = number_of(cell, decimal);
    if (!value && !trimmed(cell).empty() && !says_no_value(cell)) return std::nullopt;
    if (value && !std::isfinite(*value)) return std::nullopt;
    cells.push_back(value ? base::exact_number_text(*value) : std::string());
    any = any || value;
  }
  return any ? std::optional(std::move(cells)) : std::nullopt;
}

class Converter {
 public:
  Converter(const Table& table, char decimal, const std::filesystem::path& file)
      : table_(table), decimal_(decimal), file_(file) {}

  [[nodiscard]] std::vector<double> numbers(const Source& source) const {
    std::vector<double> out;
    for (const Line& row : table_.rows) {
      const auto& cell = row.cells[source.column];
      const auto value = number_of(cell, decimal_);
      if (!value)
        throw RecordingError(Fault::kNotNumber, file_, row.number,
                             shown(table_, source.column) + " is \"" + base::printable(cell.substr(0, 40)) +
                                 "\"; a number is needed, with a decimal " + (decimal_ == '.' ? "point" : "comma"));
      out.push_back(*value);
    }
    return out;
  }

  /// Seconds since midnight of the first row.
  [[nodiscard]] std::vector<double> clock_times_s(const Source& source, std::vector<std::string>& notes) const {
    std::vector<double> out;
    double passed_s = 0.0, last_s = 0.0;
    for (const Line& row : table_.rows) {
      const auto& cell = row.cells[source.column];
      const auto read_s = clock_s(cell);
      if (!read_s)
        throw RecordingError(Fault::kNotNumber, file_, row.number,
                             shown(table_, source.column) + " is \"" + base::printable(cell.substr(0, 40)) +
                                 "\"; a time of day is needed, as 14:05:00.25, or 05:00.25");
      const bool has_hours = std::ranges::count(cell, ':') == 2;
      const double again_s = has_hours ? 86400.0 : 3600.0;
      if (!out.empty() && *read_s < last_s - 0.5 * again_s) {
        passed_s += again_s;
        notes.push_back("line " + std::to_string(row.number) + ": " + shown(table_, source.column) +
                        (has_hours ? " passes midnight" : " begins another hour") + "; it was taken to go on");
      }
      last_s = *read_s;
      out.push_back(*read_s + passed_s);
    }
    return out;
  }

  /// In the recording's unit and sign, within what any machine records.
  [[nodiscard]] std::vector<double> values(const Source& source, double offset) const {
    auto out = numbers(source);
    const auto* range =
        std::ranges::find(messages::kPhysicalRanges, unit_of(source.field), &messages::PhysicalRange::unit);
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double read = out[i];
      out[i] = source.sign * times(source.unit.factor, read - source.unit.zero) + offset;
      if (!(std::fabs(out[i]) <= range->most))
        throw RecordingError(Fault::kRange, file_, table_.rows[i].number,
                             shown(table_, source.column) + ": " + said(read, source.unit.name) + " are " +
                                 said(out[i], range->unit) + "; no machine records more than " +
                                 said(range->most, range->unit) + ": is the unit right?");
    }
    return out;
  }

  [[nodiscard]] std::vector<double> times_s(const Source& source, std::vector<std::string>& notes) const {
    constexpr double kCounter = 4294967296.0;
    const bool of_day = source.unit.name == kClock;
    auto out = of_day ? clock_times_s(source, notes) : numbers(source);
    const std::string_view unit = of_day ? "s" : source.unit.name;
    double begun_again = 0.0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double read = out[i];
      const bool counts = source.unit.name == "us" || source.unit.name == "ms";
      const double last = i > 0 ? out[i - 1] - begun_again : 0.0;
      if (i > 0 && counts && last > 0.9 * kCounter && last < kCounter && read < 0.1 * kCounter &&
          read == std::floor(read)) {
        begun_again += kCounter;
        notes.push_back("line " + std::to_string(table_.rows[i].number) + ": the 32-bit counter of " +
                        shown(table_, source.column) + " begins again; it was taken to go on");
      }
      out[i] = read + begun_again;
      if (i == 0 || out[i] > out[i - 1]) continue;
      const bool still = out[i] == out[i - 1];
      throw RecordingError(
          Fault::kTime, file_, table_.rows[i].number,
          std::string("time ") + (still ? "stands still" : "runs backwards") + ": " + said(read, unit) + " after " +
              said(last, unit) +
              (still ? "; two rows cannot have one time: is its resolution too coarse for the rate?"
                     : "; does another test begin here? Put an empty line and its header between them"));
    }
    for (double& t : out) t = times(source.unit.factor, t);
    return out;
  }

 private:
  const Table& table_;
  char decimal_;
  const std::filesystem::path& file_;
};

}  // namespace

Test convert(const Table& table, const std::vector<Source>& sources, char decimal, double zero_mm,
             const std::filesystem::path& file, std::optional<double> load_N) {
  Test test{.line = table.line,
            .frame = {},
            .pressure = {},
            .sources = sources,
            .columns = table.columns,
            .notes = {},
            .kept = {},
            .not_kept = {}};
  const Converter converter(table, decimal, file);
  const Source* time = source_of(sources, Field::kTime);
  const auto t_s = converter.times_s(*time, test.notes);
  const Source* position = source_of(sources, Field::kPosition);
  const Source* force = source_of(sources, Field::kForce);
  if (position != nullptr && (force != nullptr || load_N))
    test.frame = messages::FrameSamples{
        t_s, converter.values(*position, zero_mm),
        force != nullptr ? converter.values(*force, 0.0) : std::vector<double>(t_s.size(), *load_N)};
  if (const Source* pressure = source_of(sources, Field::kPressure))
    test.pressure = messages::PressureSamples{t_s, converter.values(*pressure, 0.0)};
  std::map<std::string, int> names;
  for (const std::string_view name : kOfTheExport) names.emplace(name, 1);
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    if (std::ranges::find(sources, c, &Source::column) != sources.end()) continue;
    const bool nothing = table.columns[c].name.empty() && std::ranges::all_of(table.rows, [c](const Line& row) {
                           return row.cells[c].find_first_not_of(" \t") == std::string::npos;
                         });
    if (nothing) continue;  // a delimiter at the ends of lines
    auto cells = number_cells(table, c, decimal);
    if (!cells)
      test.not_kept.push_back(c);
    else
      test.kept.push_back({c, {further_name(table.columns[c], c, names), std::move(*cells)}});
  }
  return test;
}

}  // namespace isorig::foreign
