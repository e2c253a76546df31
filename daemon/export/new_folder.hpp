#pragma once
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace isorig::daemon {

/// A folder for what is written into it. If it was made for that, it goes with its owner while it is empty: what failed
/// before its first file leaves nothing behind.
class NewFolder {
 public:
  explicit NewFolder(std::filesystem::path where) : path_(std::move(where)) {
    std::error_code failed;
    made_ = std::filesystem::create_directories(path_, failed);
    if (failed) throw std::runtime_error(path_.string() + ": cannot be made: " + failed.message());
  }
  ~NewFolder() {
    std::error_code ignored;
    if (made_) std::filesystem::remove(path_, ignored);  // fails when something is in it
  }
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
  bool made_ = false;
};

}  // namespace isorig::daemon
