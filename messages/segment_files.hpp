#pragma once
#include <filesystem>
#include <string>
#include <vector>

/// The files of a recording, by name.
namespace isorig::messages {

[[nodiscard]] std::string segment_name(int number);                      ///< "segment-0001.lcm"
[[nodiscard]] int segment_number(const std::filesystem::path& segment);  ///< 0 for any other name
/// Of a run's directory, in order; a segment's own path gives that alone.
[[nodiscard]] std::vector<std::filesystem::path> list_segments(const std::filesystem::path& run_dir);

}  // namespace isorig::messages
