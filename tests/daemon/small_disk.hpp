#pragma once
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <utility>

namespace isorig::daemon::testing {

/// A real disk of 2 MiB (tmpfs), and somebody else who fills it.
class SmallDisk {
 public:
  explicit SmallDisk(std::filesystem::path at) : path_(std::move(at)) {
    std::filesystem::create_directory(path_);
    mounted_ = ::mount("tmpfs", path_.c_str(), "tmpfs", 0, "size=2m") == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(path_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  [[nodiscard]] bool mounted() const { return mounted_; }  ///< false: errno says why
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  void fill() const {
    const int hog = ::open((path_ / "hog").c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    ASSERT_GE(hog, 0);
    const std::string block(4096, 'x');
    while (::write(hog, block.data(), block.size()) > 0) {
    }
    ::close(hog);
  }
  void make_room() const { std::filesystem::remove(path_ / "hog"); }
  /// As `mount -o remount,ro` does; false: errno says why not.
  [[nodiscard]] bool remount_read_only() const {
    return ::mount("tmpfs", path_.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, "size=2m") == 0;
  }

 private:
  std::filesystem::path path_;
  bool mounted_ = false;
};

}  // namespace isorig::daemon::testing
