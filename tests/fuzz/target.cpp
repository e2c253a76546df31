#include "target.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace isorig::fuzz {

void require(bool holds, std::string_view what) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: %.*s\n", static_cast<int>(what.size()), what.data());
  std::abort();
}

void refused(std::string_view why) {
  require(!why.empty(), "an input was refused without a reason");
}

void refused(const base::ConfigError& error) {
  require(!error.diagnostics().empty(), "an input was refused without a diagnostic");
  for (const auto& each : error.diagnostics()) refused(each.message);
}

std::uint8_t Input::byte() noexcept {
  if (left_.empty()) return 0;
  const auto value = left_.front();
  left_ = left_.subspan(1);
  return value;
}

Bytes Input::take(std::size_t size) noexcept {
  const auto taken = left_.first(std::min(size, left_.size()));
  left_ = left_.subspan(taken.size());
  return taken;
}

Bytes Input::part() noexcept {
  const auto mark = text(left_).find(kPartMark);
  if (mark == std::string_view::npos) return rest();
  const auto taken = take(mark);
  take(kPartMark.size());
  return taken;
}

const std::filesystem::path& scratch() {
  struct Folder {
    Folder() {
      std::string name = std::filesystem::is_directory("/dev/shm") ? "/dev/shm/" : "/tmp/";
      name += "isorig-fuzz-XXXXXX";
      require(::mkdtemp(name.data()) != nullptr, "no folder to work in");
      path = name;
    }
    ~Folder() {
      std::error_code ignored;
      std::filesystem::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    std::filesystem::path path;
  };
  static const Folder folder;
  return folder.path;
}

void put(const std::filesystem::path& file, std::string_view bytes) {
  const int fd = ::open(file.c_str(), O_CREAT | O_WRONLY | O_TRUNC | O_CLOEXEC, 0600);
  require(fd >= 0, "the scratch file cannot be written");
  require(::write(fd, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()), "the scratch file is short");
  ::close(fd);
}

}  // namespace isorig::fuzz
