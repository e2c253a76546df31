#include "daemon/host/unix_listener.hpp"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace isorig::daemon {
namespace {

sockaddr_un address_of(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string text = path.string();
  if (text.size() >= sizeof address.sun_path) {
    throw std::runtime_error("the API socket's path is longer than " + std::to_string(sizeof address.sun_path - 1) +
                             " characters: " + text + "; choose a shorter one in [api] socket");
  }
  std::memcpy(address.sun_path, text.c_str(), text.size() + 1);
  return address;
}

/// Whatever is not a plain refusal counts as an answer: a full backlog, or a socket that may not be opened.
bool somebody_answers(const sockaddr_un& address) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool answers = fd < 0 || ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ||
                       (errno != ECONNREFUSED && errno != ENOENT);
  if (fd >= 0) ::close(fd);
  return answers;
}

}  // namespace

UnixListener::UnixListener(const std::filesystem::path& path, unsigned mode) : path_(path) {
  const auto address = address_of(path);
  if (path.has_parent_path()) std::filesystem::create_directories(path.parent_path());
  struct stat there {};
  if (::lstat(path.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) {
      throw std::runtime_error(path.string() +
                               " is there and is no socket; isorigd does not touch it: move it away, or "
                               "name another socket ([api] socket or --socket)");
    }
    if (somebody_answers(address)) {
      throw std::runtime_error("another daemon answers on " + path.string() +
                               "; stop it, or give this one another socket ([api] socket or --socket)");
    }
    std::filesystem::remove(path);
  }
  fd_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  // The mode has to hold from the first moment the socket exists, not from a chmod later.
  const mode_t old_mask = ::umask(static_cast<mode_t>(0777 & ~mode));
  const bool bound = fd_ >= 0 && ::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  const int error = errno;
  ::umask(old_mask);
  if (!bound || ::listen(fd_, SOMAXCONN) != 0) {
    const int why = bound ? errno : error;
    if (fd_ >= 0) ::close(fd_);
    throw std::runtime_error("the API socket " + path.string() + " cannot be made: " + std::strerror(why) +
                             "; check the directory and its permissions ([api] socket)");
  }
  if (::lstat(path.c_str(), &there) == 0) {
    device_ = there.st_dev;
    inode_ = there.st_ino;
  }
}

UnixListener::~UnixListener() {
  unlink();
  ::close(fd_);
}

void UnixListener::unlink() noexcept {
  struct stat there {};
  if (::lstat(path_.c_str(), &there) == 0 && there.st_dev == device_ && there.st_ino == inode_) ::unlink(path_.c_str());
}

}  // namespace isorig::daemon
