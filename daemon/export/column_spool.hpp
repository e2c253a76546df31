#pragma once
#include <cstddef>
#include <cstdio>
#include <filesystem>

namespace isorig::daemon {

/// A column on its way into a format that wants it whole: it waits in a file without a name, so that memory does not
/// grow with the recording, and is looked at through a map of that file.
class ColumnSpool {
 public:
  /// In `folder`. Throws std::system_error.
  explicit ColumnSpool(const std::filesystem::path& folder);
  ~ColumnSpool();
  ColumnSpool(const ColumnSpool&) = delete;
  ColumnSpool& operator=(const ColumnSpool&) = delete;

  /// Throws std::system_error when the disk takes no more.
  void append(const void* data, std::size_t bytes);
  /// All of it. Nothing may be appended any more.
  void* map();
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }

 private:
  std::FILE* file_ = nullptr;
  std::size_t bytes_ = 0;
  void* map_ = nullptr;
};

}  // namespace isorig::daemon
