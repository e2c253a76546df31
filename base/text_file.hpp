#pragma once
#include <cstddef>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>

namespace isorig::base {

/// A file could not be read. what(): "<path>: <reason>", where the reason says what to do.
class FileError : public std::runtime_error {
 public:
  FileError(std::filesystem::path path, std::string reason, bool missing);
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }
  [[nodiscard]] const std::string& reason() const noexcept { return reason_; }
  [[nodiscard]] bool missing() const noexcept { return missing_; }  ///< there is no such file

 private:
  std::filesystem::path path_;
  std::string reason_;
  bool missing_;
};

inline constexpr std::size_t kWholeFile = std::numeric_limits<std::size_t>::max();

/// Why `path` is not to be opened for reading: a FIFO waits for a writer, for ever when there is none, and a device may
/// have no end. Empty for a file, a folder, and what is not there or may not be looked at: opening tells those.
[[nodiscard]] std::string why_not_a_file(const std::filesystem::path& path);

/// The bytes of a file, the first `most_bytes` of them. Throws FileError.
[[nodiscard]] std::string read_text_file(const std::filesystem::path& path, std::size_t most_bytes = kWholeFile);

/// The same for a file that a person named: throws ConfigError, as what is wrong in the file itself does.
[[nodiscard]] std::string read_config_file(const std::filesystem::path& path, std::size_t most_bytes = kWholeFile);

}  // namespace isorig::base
