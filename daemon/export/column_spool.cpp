#include "daemon/export/column_spool.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

namespace isorig::daemon {
namespace {

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

ColumnSpool::ColumnSpool(const std::filesystem::path& folder) {
  auto name = (folder / ".column-XXXXXX").string();
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) fail(folder.string() + ": cannot be written");
  ::unlink(name.c_str());
  file_ = ::fdopen(fd, "w+b");
  if (file_ == nullptr) {
    ::close(fd);
    fail(folder.string() + ": cannot be written");
  }
}

ColumnSpool::~ColumnSpool() {
  if (map_ != nullptr) ::munmap(map_, bytes_);
  std::fclose(file_);
}

void ColumnSpool::append(const void* data, std::size_t bytes) {
  if (bytes == 0) return;
  if (std::fwrite(data, 1, bytes, file_) != bytes) fail("a column of the export cannot be kept");
  bytes_ += bytes;
}

void* ColumnSpool::map() {
  if (bytes_ == 0 || map_ != nullptr) return map_;
  if (std::fflush(file_) != 0) fail("a column of the export cannot be kept");
  void* at = ::mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE, ::fileno(file_), 0);
  if (at == MAP_FAILED) fail("a column of the export cannot be read");
  return map_ = at;
}

}  // namespace isorig::daemon
