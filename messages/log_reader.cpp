#include "messages/log_reader.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>

namespace isorig::messages {
namespace {

constexpr std::array<std::uint8_t, 4> kSyncWord{0xED, 0xA1, 0xDA, 0x01};
constexpr std::size_t kHeaderBytes = 28;
constexpr std::uint64_t kMaxChannel = 999;  // liblcm's own bound

std::uint64_t big_endian(std::span<const std::uint8_t> bytes) {
  std::uint64_t value = 0;
  for (const auto b : bytes) value = value << 8U | b;
  return value;
}

}  // namespace

LogReader::LogReader(const std::filesystem::path& path) : path_(path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) throw std::system_error(errno, std::generic_category(), "cannot open " + path.string());
  struct stat s {};
  const bool known = ::fstat(fd, &s) == 0;
  void* at = MAP_FAILED;
  int reason = errno;
  if (known && s.st_size > 0) {
    at = ::mmap(nullptr, static_cast<std::size_t>(s.st_size), PROT_READ, MAP_PRIVATE, fd, 0);
    reason = errno;
  }
  ::close(fd);
  if (known && s.st_size == 0) return;
  if (at == MAP_FAILED) {
    throw std::system_error(reason, std::generic_category(), "cannot read " + path.string());
  }
  ::madvise(at, static_cast<std::size_t>(s.st_size), MADV_SEQUENTIAL);
  file_ = {static_cast<const std::uint8_t*>(at), static_cast<std::size_t>(s.st_size)};
}

LogReader::~LogReader() {
  if (!file_.empty()) ::munmap(const_cast<std::uint8_t*>(file_.data()), file_.size());
}

std::optional<LogEvent> LogReader::event_at(std::size_t offset, std::size_t& end) const {
  const auto rest = file_.subspan(offset);
  if (rest.size() < kHeaderBytes || !std::equal(kSyncWord.begin(), kSyncWord.end(), rest.begin())) return {};
  const std::uint64_t channel = big_endian(rest.subspan(20, 4));
  const std::uint64_t data = big_endian(rest.subspan(24, 4));
  if (channel == 0 || channel > kMaxChannel || kHeaderBytes + channel + data > rest.size()) return {};
  end = offset + kHeaderBytes + channel + data;
  return LogEvent{static_cast<std::int64_t>(big_endian(rest.subspan(4, 8))),
                  static_cast<std::int64_t>(big_endian(rest.subspan(12, 8))),
                  {reinterpret_cast<const char*>(rest.data()) + kHeaderBytes, channel},
                  rest.subspan(kHeaderBytes + channel, data)};
}

std::optional<LogEvent> LogReader::next() {
  if (offset_ >= file_.size()) return {};
  std::size_t end = 0;
  if (auto event = event_at(offset_, end)) {
    offset_ = end;
    return event;
  }
  const std::size_t bad = offset_;
  for (auto from = file_.begin() + static_cast<std::ptrdiff_t>(bad) + 1;;) {
    from = std::search(from, file_.end(), kSyncWord.begin(), kSyncWord.end());
    if (from == file_.end()) break;
    const auto at = static_cast<std::size_t>(from - file_.begin());
    if (auto event = event_at(at, end)) {
      damage_.push_back({path_, bad, at - bad, false});
      offset_ = end;
      return event;
    }
    ++from;
  }
  damage_.push_back({path_, bad, file_.size() - bad, true});
  offset_ = file_.size();
  return {};
}

}  // namespace isorig::messages
