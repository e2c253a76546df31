#include "messages/log_reader.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <stdexcept>
#include <system_error>

#include "base/text_file.hpp"
#include "messages/crc32c.hpp"

namespace isorig::messages {
namespace {

constexpr std::array<std::uint8_t, 4> kSyncWord{0xED, 0xA1, 0xDA, 0x01};
static_assert(kLogSyncWord == 0xEDA1DA01);
constexpr std::uint64_t kMaxChannel = 999;  // liblcm's own bound
constexpr int kFirstEvents = 64;            // that are asked for checksums

}  // namespace

LogReader::LogReader(const std::filesystem::path& path, Checksums checksums) : path_(path) {
  if (const auto why = base::why_not_a_file(path); !why.empty()) throw std::runtime_error(path.string() + " " + why);
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
  has_checksums_ = checksums == Checksums::kAlways || find_checksums();
}

LogReader::~LogReader() {
  if (!file_.empty()) ::munmap(const_cast<std::uint8_t*>(file_.data()), file_.size());
}

std::optional<LogReader::Found> LogReader::event_at(std::size_t offset) const {
  const auto rest = file_.subspan(offset);
  if (rest.size() < kLogHeaderBytes || !std::equal(kSyncWord.begin(), kSyncWord.end(), rest.begin())) return {};
  const std::uint64_t channel = big_endian(rest.data() + 20, 4);
  const std::uint64_t data = big_endian(rest.data() + 24, 4);
  if (channel == 0 || channel > kMaxChannel || kLogHeaderBytes + channel + data > rest.size()) return {};
  const auto size = static_cast<std::size_t>(kLogHeaderBytes + channel + data);
  Found found;
  found.end = offset + size;
  found.event = {static_cast<std::int64_t>(big_endian(rest.data() + 4, 8)),
                 static_cast<std::int64_t>(big_endian(rest.data() + 12, 8)),
                 {reinterpret_cast<const char*>(rest.data()) + kLogHeaderBytes, channel},
                 rest.subspan(kLogHeaderBytes + channel, data)};
  if (data >= kLogChecksumBytes) {
    found.checksum = static_cast<std::uint32_t>(big_endian(rest.data() + size - kLogChecksumBytes, kLogChecksumBytes));
    found.checked = crc32c(rest.first(size - kLogChecksumBytes)) == found.checksum;
  }
  return found;
}

std::optional<std::size_t> LogReader::sync_word_from(std::size_t offset) const {
  if (offset >= file_.size()) return {};
  const auto found =
      std::search(file_.begin() + static_cast<std::ptrdiff_t>(offset), file_.end(), kSyncWord.begin(), kSyncWord.end());
  if (found == file_.end()) return {};
  return static_cast<std::size_t>(found - file_.begin());
}

bool LogReader::find_checksums() const {
  std::size_t from = 0;
  for (int i = 0; i < kFirstEvents; ++i) {
    const auto at = sync_word_from(from);
    if (!at) return false;
    const auto found = event_at(*at);
    if (found && found->checked) return true;
    from = *at + 1;
  }
  return false;
}

LogEvent LogReader::give(const Found& found) {
  add_to(tally_, found.end - offset_, found.checksum);
  offset_ = found.end;
  LogEvent event = found.event;
  if (has_checksums_) event.data = event.data.first(event.data.size() - kLogChecksumBytes);
  return event;
}

std::optional<LogEvent> LogReader::next() {
  if (offset_ >= file_.size()) return {};
  const auto good = [&](const std::optional<Found>& found) { return found && (found->checked || !has_checksums_); };
  const auto here = event_at(offset_);
  if (good(here)) return give(*here);
  const std::size_t bad = offset_;
  for (auto at = sync_word_from(bad + 1); at; at = sync_word_from(*at + 1)) {
    const auto found = event_at(*at);
    if (!good(found)) continue;
    damage_.push_back({path_, bad, *at - bad, false, false});
    offset_ = *at;
    return give(*found);
  }
  // An event that ends with the file is not torn, but altered.
  const auto rest = file_.subspan(bad);
  const bool begun =
      std::equal(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(std::min(rest.size(), kSyncWord.size())),
                 kSyncWord.begin());
  damage_.push_back({path_, bad, rest.size(), !here || here->end != file_.size(), begun});
  offset_ = file_.size();
  return {};
}

LogTally tally_of(const std::filesystem::path& log, Checksums checksums) {
  LogReader reader(log, checksums);
  while (reader.next()) {
  }
  return reader.tally();
}

}  // namespace isorig::messages
