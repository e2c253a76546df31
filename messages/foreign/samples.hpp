#pragma once
#include <optional>
#include <string>
#include <vector>

#include "messages/foreign/mapping.hpp"
#include "messages/further_columns.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {

/// One test of a file, in the units and signs of a recording.
struct Test {
  std::size_t line = 0;  ///< of its table
  std::optional<messages::FrameSamples> frame;
  std::optional<messages::PressureSamples> pressure;
  std::vector<Source> sources;
  std::vector<Column> columns;
  std::vector<std::string> notes;
  /// Columns of numbers that no field is read from, in the units of the file: `index` of each and its name in a
  /// recording. Of a test with a frame they belong to the frame.
  struct Kept {
    std::size_t index = 0;
    messages::FurtherColumn column;
  };
  std::vector<Kept> kept;
  std::vector<std::size_t> not_kept;  ///< columns of words, or without a number
};

/// Converts the rows of a table. The position is `zero_mm` where the file has zero. A counter of 32 bits (micros() and
/// millis() of a Teensy) that begins again goes on, and a note says so. Every cell of a mapped column has to be a
/// number within the ranges of messages/csv.hpp, and time has to increase. A position without a force is a frame under
/// the constant `load_N`. Throws RecordingError with the line.
[[nodiscard]] Test convert(const Table& table, const std::vector<Source>& sources, char decimal, double zero_mm,
                           const std::filesystem::path& file, std::optional<double> load_N = std::nullopt);

}  // namespace isorig::foreign
