#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::messages {

/// A column of frame.csv or pressure.csv behind those of the format (a temperature, a current). No program here
/// computes with it: cells are carried as they stand in the file, empty where a value does not exist.
struct FurtherColumn {
  std::string name;
  std::vector<std::string> cells;
};

/// Those behind the first `own` of a file that read_frame_csv() or read_pressure_csv() takes: their checks are not made
/// again. Throws RecordingError where the file cannot be read or has changed since.
[[nodiscard]] std::vector<FurtherColumn> read_further_columns(const std::filesystem::path& file, std::size_t own);
inline constexpr std::size_t kFrameColumns = 3, kPressureColumns = 2;

/// Of the two files of a recording, in their order.
struct FurtherColumns {
  std::vector<FurtherColumn> frame, pressure;
};

/// As write_recording() without them. Each has as many cells as its file has rows, a name of its own, and no comma,
/// quote or line end.
std::optional<Replaced> write_recording(const std::filesystem::path& folder, const Recording& recording,
                                        const FurtherColumns& further);

/// The text of a CSV with cells put behind its rows.
[[nodiscard]] std::string with_further_columns(const std::string& csv, std::span<const FurtherColumn> further);

}  // namespace isorig::messages
