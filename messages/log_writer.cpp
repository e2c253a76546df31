#include "messages/log_writer.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

namespace isorig::messages {
namespace {

constexpr std::uint32_t kSyncWord = 0xEDA1DA01;
constexpr std::size_t kHeaderBytes = 28;

template <typename T>
std::uint8_t* put_big_endian(std::uint8_t* to, T value) {
  for (int shift = static_cast<int>(sizeof(T)) * 8 - 8; shift >= 0; shift -= 8) {
    *to++ = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> static_cast<unsigned>(shift));
  }
  return to;
}

}  // namespace

LogWriter::LogWriter(const std::filesystem::path& path, Options options)
    : path_(path), options_(std::move(options)) {
  fd_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "cannot create " + path.string());
  held_.reserve(options_.write_bytes * 2);
}

LogWriter::~LogWriter() {
  flush();
  ::close(fd_);
}

bool LogWriter::append(std::string_view channel, std::int64_t utime_us, std::span<const std::uint8_t> data) {
  const std::size_t event_bytes = kHeaderBytes + channel.size() + data.size();
  if (held_.size() + event_bytes > options_.max_held_bytes && held_.size() > options_.write_bytes &&
      !flush() && held_.size() + event_bytes > options_.max_held_bytes) {
    ++lost_events_;
    return false;
  }
  std::array<std::uint8_t, kHeaderBytes> header{};
  auto* to = put_big_endian(header.data(), kSyncWord);
  to = put_big_endian(to, events_++);
  to = put_big_endian(to, utime_us);
  to = put_big_endian(to, static_cast<std::uint32_t>(channel.size()));
  put_big_endian(to, static_cast<std::uint32_t>(data.size()));
  held_.insert(held_.end(), header.begin(), header.end());
  held_.insert(held_.end(), channel.begin(), channel.end());
  held_.insert(held_.end(), data.begin(), data.end());
  // With a disk that takes nothing, every event would try again: leave that to the caller's next sync.
  if (held_.size() >= options_.write_bytes && error_.empty()) flush();
  return true;
}

bool LogWriter::flush() {
  error_.clear();
  std::size_t done = 0;
  bool may_make_room = true;
  while (done < held_.size()) {
    const ssize_t n = ::write(fd_, held_.data() + done, held_.size() - done);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
      continue;
    }
    if (n < 0 && errno == EINTR) continue;
    const int reason = n < 0 ? errno : ENOSPC;
    const bool full = reason == ENOSPC || reason == EDQUOT;
    if (full && may_make_room && options_.make_room && options_.make_room()) {
      may_make_room = false;
      continue;
    }
    error_ = path_.string() + ": " + std::strerror(reason);
    break;
  }
  written_bytes_ += done;
  held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(done));
  return held_.empty();
}

bool LogWriter::sync() {
  const bool flushed = flush();
  const std::uint64_t at_least = written_bytes_;
  if (::fdatasync(fd_) != 0 && errno != EINVAL && errno != EROFS) {  // those two: a special file, as in tests
    // The kernel may have dropped dirty pages; nothing that was not synced before can be trusted.
    error_ = path_.string() + ": " + std::strerror(errno);
    return false;
  }
  synced_bytes_ = at_least;
  return flushed;
}

}  // namespace isorig::messages
