#pragma once
#include <cstddef>
#include <filesystem>
#include <string>

namespace isorig::base {

/// What text_file.cpp and beneath.cpp share: the bytes of an open file from its beginning, the first `most_bytes` of
/// them. `path` is for the message. Throws FileError.
[[nodiscard]] std::string read_open_file(int fd, const std::filesystem::path& path, std::size_t most_bytes);

}  // namespace isorig::base
