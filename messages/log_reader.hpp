#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace isorig::messages {

/// One event of an LCM log; views into the reader's file.
struct LogEvent {
  std::int64_t number = 0;
  std::int64_t utime_us = 0;
  std::string_view channel;
  std::span<const std::uint8_t> data;
};

/// Bytes that are no whole event.
struct LogDamage {
  std::filesystem::path file;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  bool at_end = false;  ///< the writer was interrupted; else something destroyed the middle
};

/// Reads an LCM event log. liblcm's reader stops at the first event that is not whole and says nothing; after
/// a crash one wants everything up to there, how much was cut, and, should a disk have lost a block in the
/// middle, what comes after it. The whole file is mapped.
class LogReader {
 public:
  explicit LogReader(const std::filesystem::path& path);  ///< throws std::system_error
  ~LogReader();
  LogReader(const LogReader&) = delete;
  LogReader& operator=(const LogReader&) = delete;

  /// The next whole event; nothing at the end.
  std::optional<LogEvent> next();
  [[nodiscard]] const std::vector<LogDamage>& damage() const noexcept { return damage_; }
  [[nodiscard]] std::uint64_t size_bytes() const noexcept { return file_.size(); }

 private:
  [[nodiscard]] std::optional<LogEvent> event_at(std::size_t offset, std::size_t& end) const;

  std::filesystem::path path_;
  std::span<const std::uint8_t> file_;
  std::size_t offset_ = 0;
  std::vector<LogDamage> damage_;
};

}  // namespace isorig::messages
