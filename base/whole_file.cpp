#include "base/whole_file.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace isorig::base {

std::filesystem::path aside_of(const std::filesystem::path& file) {
  auto aside = file;
  aside += ".part-" + std::to_string(::getpid());
  return aside;
}

WriteError::WriteError(std::filesystem::path file, std::string reason)
    : std::runtime_error(file.string() + ": cannot be written: " + reason),
      file_(std::move(file)),
      reason_(std::move(reason)) {}

WholeFiles::~WholeFiles() {
  std::error_code ignored;
  for (std::size_t i = in_place_; i < files_.size(); ++i) std::filesystem::remove(aside_of(files_[i]), ignored);
}

void WholeFiles::add(const std::filesystem::path& file, std::string_view text) {
  std::error_code error;
  // A rename does not say so before everything is written.
  if (std::filesystem::is_directory(file, error)) throw WriteError(file, "it is a folder");
  std::FILE* out = std::fopen(aside_of(file).c_str(), "wb");
  if (out == nullptr) throw WriteError(file, std::strerror(errno));
  files_.push_back(file);
  errno = 0;
  const bool written = std::fwrite(text.data(), 1, text.size(), out) == text.size();
  int why = written ? 0 : errno;
  if (std::fclose(out) != 0 && why == 0) why = errno;
  if (!written || why != 0) throw WriteError(file, std::strerror(why != 0 ? why : EIO));
}

void WholeFiles::put() {
  for (; in_place_ < files_.size(); ++in_place_) {
    std::error_code error;
    std::filesystem::rename(aside_of(files_[in_place_]), files_[in_place_], error);
    if (error) throw WriteError(files_[in_place_], error.message());
  }
}

void write_whole_file(const std::filesystem::path& file, std::string_view text) {
  WholeFiles one;
  one.add(file, text);
  one.put();
}

}  // namespace isorig::base
