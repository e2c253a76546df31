#pragma once
#include <filesystem>
#include <string_view>

namespace isorig::base {

/// Where a file is written until it is whole: beside it, with this process in its name, so that two processes that
/// write the same file do not write into each other's.
[[nodiscard]] std::filesystem::path aside_of(const std::filesystem::path& file);

/// Writes a file aside and renames it: what stands at `file` is the whole text or what stood there before, and nothing
/// stays beside it. Throws std::runtime_error "<file>: cannot be written: <reason>".
void write_whole_file(const std::filesystem::path& file, std::string_view text);

}  // namespace isorig::base
