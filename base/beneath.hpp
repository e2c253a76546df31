#pragma once
#include <sys/types.h>

#include <cstddef>
#include <filesystem>
#include <string>

#include "base/text_file.hpp"

/// Files that lie in a folder, for who may not be led out of it: whoever may write there could put a link in the place
/// of a file between the moment it is looked at and the moment it is opened.
namespace isorig::base {

/// open(2) of folder/relative, step by step: no part of `relative` may be "." or "..", and no folder or file on the way
/// a symbolic link. `folder` itself may be one: who names it is trusted. -1 with errno, ELOOP for a link.
[[nodiscard]] int open_beneath(const std::filesystem::path& folder, const std::filesystem::path& relative, int flags,
                               mode_t mode = 0);

/// The bytes of a plain file there, the first `most_bytes` of them. Throws FileError.
[[nodiscard]] std::string read_text_beneath(const std::filesystem::path& folder, const std::filesystem::path& relative,
                                            std::size_t most_bytes = kWholeFile);

}  // namespace isorig::base
