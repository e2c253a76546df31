#include "base/beneath.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "base/text_file_read.hpp"

namespace isorig::base {
namespace {

/// A link in the middle is "not a directory" for open(2); it is a link for people.
int error_of(int directory, const std::string& name, int error) {
  struct stat status {};
  if (error == ENOTDIR && ::fstatat(directory, name.c_str(), &status, AT_SYMLINK_NOFOLLOW) == 0 &&
      S_ISLNK(status.st_mode)) {
    return ELOOP;
  }
  return error;
}

}  // namespace

int open_beneath(const std::filesystem::path& folder, const std::filesystem::path& relative, int flags, mode_t mode) {
  if (relative.empty() || relative.is_absolute()) {
    errno = EINVAL;
    return -1;
  }
  int at = ::open(folder.empty() ? "." : folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (at < 0) return -1;
  for (auto part = relative.begin(); part != relative.end(); ++part) {
    const auto name = part->string();
    const bool last = std::next(part) == relative.end();
    int next = -1, error = EINVAL;
    if (!name.empty() && name != "." && name != "..") {
      next = last ? ::openat(at, name.c_str(), flags | O_NOFOLLOW | O_CLOEXEC, mode)
                  : ::openat(at, name.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
      error = next < 0 ? error_of(at, name, errno) : 0;
    }
    ::close(std::exchange(at, next));
    if (next < 0) {
      errno = error;
      return -1;
    }
  }
  return at;
}

std::string read_text_beneath(const std::filesystem::path& folder, const std::filesystem::path& relative,
                              std::size_t most_bytes) {
  const auto path = folder / relative;
  // A FIFO would be waited for, and a device may have no end.
  const int fd = open_beneath(folder, relative, O_RDONLY | O_NONBLOCK | O_NOCTTY);
  if (fd < 0) {
    const int error = errno;
    if (error == ELOOP)
      throw FileError(path, "is a symbolic link, or leads through one; put the file itself there", false);
    throw FileError(
        path, "cannot be opened: " + std::generic_category().message(error) + "; check the path and its permissions",
        error == ENOENT || error == ENOTDIR);
  }
  const struct Close {
    int fd;
    ~Close() { ::close(fd); }
  } close{fd};
  struct stat status {};
  if (::fstat(fd, &status) != 0 || !S_ISREG(status.st_mode)) throw FileError(path, "is no plain file", false);
  return read_open_file(fd, path, most_bytes);
}

}  // namespace isorig::base
