#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "messages/log_event.hpp"

namespace isorig::messages {

/// One event of an LCM log; views into the reader's file.
struct LogEvent {
  std::int64_t number = 0;
  std::int64_t utime_us = 0;
  std::string_view channel;
  std::span<const std::uint8_t> data;
};

/// Bytes that are no event as it was written.
struct LogDamage {
  std::filesystem::path file;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  /// Nothing whole follows and no event ends here: as a writer leaves it that was interrupted. Otherwise something
  /// was altered.
  bool at_end = false;
  /// They begin as a message does: foreign bytes rarely do.
  bool begun = false;
};

/// `kAsFound`: a log in which any of the first events has a right checksum is one with checksums. `kAlways`: this log
/// has them, also where all of its first events are damaged; of a recording in which an earlier segment has checksums.
enum class Checksums { kAsFound, kAlways };

/// Reads an LCM event log. liblcm's reader stops at the first event that is not whole and says nothing; after
/// a crash one wants everything up to there, how much was cut, and, should a disk have lost a block in the
/// middle, what comes after it. The whole file is mapped.
///
/// In a log with checksums an event whose checksum is wrong is damage, and is not given out.
class LogReader {
 public:
  /// Throws std::runtime_error, std::system_error.
  explicit LogReader(const std::filesystem::path& path, Checksums checksums = Checksums::kAsFound);
  ~LogReader();
  LogReader(const LogReader&) = delete;
  LogReader& operator=(const LogReader&) = delete;

  /// The next event; nothing at the end. Its data is without the checksum.
  std::optional<LogEvent> next();
  [[nodiscard]] const std::vector<LogDamage>& damage() const noexcept { return damage_; }
  [[nodiscard]] std::uint64_t size_bytes() const noexcept { return file_.size(); }
  [[nodiscard]] std::uint64_t read_bytes() const noexcept { return offset_; }  ///< behind the event given out last
  [[nodiscard]] bool has_checksums() const noexcept { return has_checksums_; }
  /// Of the events given out so far; its checksum is meant only where the log has them.
  [[nodiscard]] const LogTally& tally() const noexcept { return tally_; }

 private:
  struct Found {
    LogEvent event;
    std::size_t end = 0;
    std::uint32_t checksum = 0;
    bool checked = false;
  };
  [[nodiscard]] std::optional<Found> event_at(std::size_t offset) const;
  [[nodiscard]] std::optional<std::size_t> sync_word_from(std::size_t offset) const;
  [[nodiscard]] bool find_checksums() const;
  LogEvent give(const Found& found);

  std::filesystem::path path_;
  std::span<const std::uint8_t> file_;
  bool has_checksums_ = false;
  std::size_t offset_ = 0;
  LogTally tally_;
  std::vector<LogDamage> damage_;
};

/// Of a whole file.
[[nodiscard]] LogTally tally_of(const std::filesystem::path& log, Checksums checksums = Checksums::kAsFound);

}  // namespace isorig::messages
