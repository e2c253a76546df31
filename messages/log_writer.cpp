#include "messages/log_writer.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "messages/crc32c.hpp"

namespace isorig::messages {
namespace {

std::size_t event_size(const std::uint8_t* event) {
  return kLogHeaderBytes + big_endian(event + 20, 4) + big_endian(event + 24, 4);
}

}  // namespace

LogWriter::LogWriter(const std::filesystem::path& path, Options options) : path_(path), options_(std::move(options)) {
  fd_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "cannot create " + path.string());
  held_.reserve(options_.write_bytes * 2);
}

LogWriter::~LogWriter() {
  flush();
  ::close(fd_);
}

bool LogWriter::append(std::string_view channel, std::int64_t utime_us, std::span<const std::uint8_t> data) {
  const std::size_t event_bytes = kLogHeaderBytes + channel.size() + data.size() + kLogChecksumBytes;
  if (held_bytes() + event_bytes > options_.max_held_bytes && held_bytes() > options_.write_bytes && !flush() &&
      held_bytes() + event_bytes > options_.max_held_bytes) {
    ++lost_events_;
    return false;
  }
  const std::size_t at = held_.size();
  held_.resize(at + event_bytes);
  auto* to = put_big_endian(held_.data() + at, kLogSyncWord);
  to = put_big_endian(to, tally_.events);
  to = put_big_endian(to, utime_us);
  to = put_big_endian(to, static_cast<std::uint32_t>(channel.size()));
  to = put_big_endian(to, static_cast<std::uint32_t>(data.size() + kLogChecksumBytes));
  to = std::copy(channel.begin(), channel.end(), to);
  to = std::copy(data.begin(), data.end(), to);
  const auto checksum = crc32c({held_.data() + at, event_bytes - kLogChecksumBytes});
  put_big_endian(to, checksum);
  add_to(tally_, event_bytes, checksum);
  // With a disk that takes nothing, every event would try again: leave that to the caller's next sync.
  if (held_bytes() >= options_.write_bytes && error_.empty()) flush();
  return true;
}

bool LogWriter::flush() {
  if (condemned_) return held_.empty();
  error_.clear();
  std::size_t done = begun_bytes_;
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
  written_bytes_ += done - begun_bytes_;
  std::size_t whole = 0;
  while (whole < done && whole + event_size(held_.data() + whole) <= done) {
    const std::size_t size = event_size(held_.data() + whole);
    whole += size;
    add_to(written_tally_, size,
           static_cast<std::uint32_t>(big_endian(held_.data() + whole - kLogChecksumBytes, kLogChecksumBytes)));
  }
  held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(whole));
  begun_bytes_ = done - whole;
  return held_.empty();
}

bool LogWriter::sync() {
  const bool flushed = flush();
  if (condemned_) return false;
  const std::uint64_t at_least = written_bytes_;
  if (::fdatasync(fd_) != 0 && errno != EINVAL) {  // a special file, as in tests
    condemned_ = true;
    error_ = path_.string() + ": fdatasync: " + std::strerror(errno);
    return false;
  }
  struct stat s {};
  if (::fstat(fd_, &s) == 0 && s.st_nlink == 0) {
    condemned_ = true;
    error_ = path_.string() + ": was removed while it was written";
    return false;
  }
  synced_bytes_ = at_least;
  return flushed;
}

void LogWriter::hand_over(
    const std::function<void(std::string_view, std::int64_t, std::span<const std::uint8_t>)>& to) {
  for (std::size_t at = 0; at < held_.size(); at += event_size(held_.data() + at)) {
    const auto* event = held_.data() + at;
    const auto channel = big_endian(event + 20, 4), data = big_endian(event + 24, 4);
    to({reinterpret_cast<const char*>(event) + kLogHeaderBytes, channel},
       static_cast<std::int64_t>(big_endian(event + 12, 8)),
       {event + kLogHeaderBytes + channel, data - kLogChecksumBytes});
  }
  held_.clear();
  begun_bytes_ = 0;
  tally_ = written_tally_;
}

}  // namespace isorig::messages
