#pragma once
#include <filesystem>
#include <string>

namespace isorig::base {

/// Why `path` is not to be opened for reading: a FIFO waits for a writer, for ever when there is none, and a device may
/// have no end. Empty for a file, a folder, and what is not there or may not be looked at: opening tells those.
[[nodiscard]] std::string why_not_a_file(const std::filesystem::path& path);

}  // namespace isorig::base
