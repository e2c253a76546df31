#include "base/whole_file.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <string>

namespace isorig::base {

std::filesystem::path aside_of(const std::filesystem::path& file) {
  auto aside = file;
  aside += ".part-" + std::to_string(::getpid());
  return aside;
}

void write_whole_file(const std::filesystem::path& file, std::string_view text) {
  const auto aside = aside_of(file);
  std::error_code error;
  // A rename does not say so before everything is written.
  if (std::filesystem::is_directory(file, error))
    throw std::runtime_error(file.string() + ": cannot be written: it is a folder");
  const auto fail = [&](int why) {
    std::filesystem::remove(aside, error);
    throw std::runtime_error(file.string() + ": cannot be written: " + std::strerror(why));
  };
  std::FILE* out = std::fopen(aside.c_str(), "wb");
  if (out == nullptr) fail(errno);
  errno = 0;
  const bool written = std::fwrite(text.data(), 1, text.size(), out) == text.size();
  int why = written ? 0 : errno;
  if (std::fclose(out) != 0 && why == 0) why = errno;
  if (!written || why != 0) fail(why != 0 ? why : EIO);
  std::filesystem::rename(aside, file, error);
  if (error) fail(error.value());
}

}  // namespace isorig::base
