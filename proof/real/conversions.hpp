#pragma once
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"

/// Real measurements of others, as recordings that `isorig diagnose` takes: one function for each kind of file. Where
/// the files come from, and what is known of them, stands beside them (PROVENANCE.md of each folder).
namespace isorig::proof {

/// A CSV with a header: the named columns, whatever else there is. Rows whose time does not increase are left
/// out, since some of the loggers wrote a millisecond twice. Throws std::runtime_error that names the file.
[[nodiscard]] std::vector<std::vector<double>> read_columns(const std::filesystem::path& file,
                                                            std::span<const std::string_view> names);

[[nodiscard]] messages::Recording emps_axis(const std::filesystem::path& file);
[[nodiscard]] messages::Recording pendulum(const std::filesystem::path& file);
/// A relaxation of half an hour, thinned as it slows down.
[[nodiscard]] messages::Recording elastomer(const std::filesystem::path& file);
[[nodiscard]] messages::Recording elastomer_cycle(const std::filesystem::path& file);
[[nodiscard]] messages::Recording silicone(const std::filesystem::path& file);
[[nodiscard]] messages::Recording cylinder(const std::filesystem::path& file);
[[nodiscard]] messages::Recording festo(const std::filesystem::path& file);
[[nodiscard]] messages::Recording filling(const std::filesystem::path& file);
[[nodiscard]] messages::Recording leak(const std::filesystem::path& file);
[[nodiscard]] messages::Recording lifting_muscle(const std::filesystem::path& file);
[[nodiscard]] messages::Recording tanks(const std::filesystem::path& file);

}  // namespace isorig::proof
