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

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "host";
}

}  // namespace isorig::base
