#pragma once
#include <sys/types.h>

#include <filesystem>

namespace isorig::daemon {

/// A Unix socket that listens, made with its mode from the first moment. A socket file that nobody answers on is
/// replaced; one that answers is another daemon's, also of two that begin in the same moment; a file of any other kind
/// is somebody's work and stays. Throws std::runtime_error, saying which. Takes its file away with it, if that is still
/// its own.
class UnixListener {
 public:
  UnixListener(const std::filesystem::path& path, unsigned mode);
  ~UnixListener();
  UnixListener(const UnixListener&) = delete;
  UnixListener& operator=(const UnixListener&) = delete;

  [[nodiscard]] int fd() const noexcept { return fd_; }
  /// Takes the file away now; what is connected stays so.
  void unlink() noexcept;

 private:
  std::filesystem::path path_;
  int fd_ = -1;
  dev_t device_ = 0;
  ino_t inode_ = 0;
};

}  // namespace isorig::daemon
