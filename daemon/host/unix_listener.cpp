#include "daemon/host/unix_listener.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <thread>

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

/// Between the look at what is there and the socket that listens, another daemon would find a dead socket, and take its
/// place. While this is there, no other isorigd makes a socket in the folder.
class OneMaker {
 public:
  explicit OneMaker(const std::filesystem::path& folder)
      : fd_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    // A folder that may not be read, or a file system without locks, leaves it to the people.
    while (fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      if (std::chrono::steady_clock::now() > deadline) {
        ::close(fd_);
        throw std::runtime_error("another process has locked " + folder.string() +
                                 ", as a daemon that makes its socket there does for a moment; end it (fuser " +
                                 folder.string() + "), or name a folder of your own ([api] socket or --socket)");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  ~OneMaker() {
    if (fd_ >= 0) ::close(fd_);
  }
  OneMaker(const OneMaker&) = delete;
  OneMaker& operator=(const OneMaker&) = delete;

 private:
  static constexpr auto kPatience = std::chrono::seconds(2);
  int fd_;
};

}  // namespace

UnixListener::UnixListener(const std::filesystem::path& path, unsigned mode) : path_(path) {
  const auto address = address_of(path);
  if (path.has_parent_path()) std::filesystem::create_directories(path.parent_path());
  const OneMaker alone(path.has_parent_path() ? path.parent_path() : ".");
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
