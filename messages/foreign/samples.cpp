#include "messages/foreign/samples.hpp"

#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "messages/csv.hpp"

namespace isorig::foreign {
namespace {

using Fault = messages::RecordingFault;
using messages::RecordingError;

const Source* source_of(const std::vector<Source>& sources, Field field) {
  const auto found = std::ranges::find(sources, field, &Source::field);
  return found == sources.end() ? nullptr : &*found;
}

std::string said(double value, std::string_view unit) {
  return base::number_text(value, 9) + " " + std::string(unit);
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

  /// In the recording's unit and sign, within what any machine records.
  [[nodiscard]] std::vector<double> values(const Source& source, double offset) const {
    auto out = numbers(source);
    const auto* range =
        std::ranges::find(messages::kPhysicalRanges, unit_of(source.field), &messages::PhysicalRange::unit);
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double read = out[i];
      out[i] = source.sign * source.unit.factor * (read - source.unit.zero) + offset;
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
    auto out = numbers(source);
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
          std::string("time ") + (still ? "stands still" : "runs backwards") + ": " + said(read, source.unit.name) +
              " after " + said(last, source.unit.name) +
              (still ? "; two rows cannot have one time: is its resolution too coarse for the rate?"
                     : "; does another test begin here? Put an empty line and its header between them"));
    }
    for (double& t : out) t *= source.unit.factor;
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
  Test test{.line = table.line, .frame = {}, .pressure = {}, .sources = sources, .columns = table.columns, .notes = {}};
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
  return test;
}

}  // namespace isorig::foreign
