#include "base/text_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <system_error>
#include <utility>

#include "base/text_file_read.hpp"
#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

class OpenFile {
 public:
  explicit OpenFile(const std::filesystem::path& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~OpenFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

[[noreturn]] void fail(const std::filesystem::path& path, const char* what, int error, const char* advice) {
  throw FileError(path, std::string(what) + ": " + std::generic_category().message(error) + "; " + advice,
                  error == ENOENT || error == ENOTDIR);
}

}  // namespace

FileError::FileError(std::filesystem::path path, std::string reason, bool missing)
    : std::runtime_error(path.string() + ": " + reason),
      path_(std::move(path)),
      reason_(std::move(reason)),
      missing_(missing) {}

std::string why_not_a_file(const std::filesystem::path& path) {
  using std::filesystem::file_type;
  std::error_code ignored;
  const char* kind = nullptr;
  switch (std::filesystem::status(path, ignored).type()) {
    case file_type::fifo:
      kind = "a pipe";
      break;
    case file_type::socket:
      kind = "a socket";
      break;
    case file_type::character:
    case file_type::block:
      kind = "a device";
      break;
    default:
      return {};
  }
  return std::string("is ") + kind + " and no file; save its content to a file and name that";
}

std::string read_open_file(int fd, const std::filesystem::path& path, std::size_t most_bytes) {
  struct stat status {};
  if (::fstat(fd, &status) != 0) fail(path, "cannot be opened", errno, "check the path and its permissions");
  // The size is a hint: files of /proc say 0, and a file may grow meanwhile.
  constexpr std::size_t kChunkBytes = std::size_t{64} << 10U;
  std::string text;
  const auto stated = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
  std::size_t wanted = std::min<std::uint64_t>(most_bytes, stated > 0 ? stated + 1 : kChunkBytes);
  std::size_t have = 0;
  while (have < most_bytes) {
    if (text.size() < wanted) text.resize(wanted);
    const auto got = ::read(fd, text.data() + have, wanted - have);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(path, "cannot be read to its end", errno, "check the disk it is on");
    if (got == 0) break;
    have += static_cast<std::size_t>(got);
    if (have == wanted) wanted += std::min(std::max(kChunkBytes, have), most_bytes - have);
  }
  text.resize(have);
  return text;
}

std::string read_text_file(const std::filesystem::path& path, std::size_t most_bytes) {
  if (auto why = why_not_a_file(path); !why.empty()) throw FileError(path, std::move(why), false);
  const OpenFile file(path);
  struct stat status {};
  if (file.fd() < 0 || ::fstat(file.fd(), &status) != 0) {
    fail(path, "cannot be opened", errno, "check the path and its permissions");
  }
  if (S_ISDIR(status.st_mode)) throw FileError(path, "cannot be opened: it is a folder; name a file in it", false);
  return read_open_file(file.fd(), path, most_bytes);
}

std::string read_config_file(const std::filesystem::path& path, std::size_t most_bytes) {
  try {
    return read_text_file(path, most_bytes);
  } catch (const FileError& e) {
    throw ConfigError({{path.string(), 0, 0, e.reason()}});
  }
}

}  // namespace isorig::base
