#pragma once
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::base {

/// Where a file is written until it is whole: beside it, with this process in its name, so that two processes that
/// write the same file do not write into each other's.
[[nodiscard]] std::filesystem::path aside_of(const std::filesystem::path& file);

/// what(): "<file>: cannot be written: <reason>".
class WriteError : public std::runtime_error {
 public:
  WriteError(std::filesystem::path file, std::string reason);
  [[nodiscard]] const std::filesystem::path& file() const noexcept { return file_; }
  [[nodiscard]] const std::string& reason() const noexcept { return reason_; }

 private:
  std::filesystem::path file_;
  std::string reason_;
};

/// Files that belong together: none takes its place before all of them are written.
class WholeFiles {
 public:
  WholeFiles() = default;
  ~WholeFiles();  ///< what is not in its place by then is gone
  WholeFiles(const WholeFiles&) = delete;
  WholeFiles& operator=(const WholeFiles&) = delete;
  /// Written aside. Throws WriteError.
  void add(const std::filesystem::path& file, std::string_view text);
  /// In their places, in the order of add(). Throws WriteError.
  void put();

 private:
  std::vector<std::filesystem::path> files_;
  std::size_t in_place_ = 0;
};

/// Writes a file aside and renames it: what stands at `file` is the whole text or what stood there before, and nothing
/// stays beside it. Throws WriteError.
void write_whole_file(const std::filesystem::path& file, std::string_view text);

}  // namespace isorig::base
