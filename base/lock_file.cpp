#include "base/lock_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "base/printable.hpp"

namespace isorig::base {

LockFile::LockFile(const std::filesystem::path& file, Shared shared) {
  fd_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0)
    throw LockError(LockError::Why::kUnwritable,
                    file.string() + ": " + std::strerror(errno) + "; name a folder that you may write");
  if (::flock(fd_, (shared == Shared::kYes ? LOCK_SH : LOCK_EX) | LOCK_NB) != 0) {
    const int error = errno;
    std::array<char, 300> who{};
    (void)!::read(fd_, who.data(), who.size() - 1);
    ::close(fd_);
    if (error == EWOULDBLOCK) {
      const std::string holder = printable(std::string(who.data()));
      throw LockError(LockError::Why::kHeld, file.string() + ": in use by " + holder + "; wait for it or end it",
                      holder);
    }
    throw LockError(LockError::Why::kNoLocks, file.string() + ": cannot be locked (" + std::strerror(error) +
                                                  "); mount the file system with locks, or name a folder elsewhere");
  }
  const std::string us = "process " + std::to_string(::getpid()) + " on " + host_name();
  (void)!::ftruncate(fd_, 0);
  (void)!::write(fd_, us.data(), us.size());
}

LockFile::~LockFile() {
  ::close(fd_);
}

FolderLock::FolderLock(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  made_ = std::filesystem::create_directories(folder_, error);
  if (error)
    throw LockError(LockError::Why::kUnwritable,
                    folder_.string() + ": " + error.message() + "; name a folder that you may write");
  fd_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    ::close(fd_);
    throw LockError(LockError::Why::kHeld, folder_.string() +
                                               ": another command writes into this folder now; wait for it, or name "
                                               "another folder with --out");
  }
}

FolderLock::~FolderLock() {
  if (made_) (void)::rmdir(folder_.c_str());  // fails where something is in it
  if (fd_ >= 0) ::close(fd_);
}

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "host";
}

}  // namespace isorig::base
