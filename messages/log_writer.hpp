#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::messages {

/// Writes one LCM event log (lcm-logplayer, lcm-logger's format: a 28-byte big-endian header of sync word
/// 0xEDA1DA01, event number, time in us, channel length and data length, then channel and data).
///
/// liblcm's own writer goes through stdio, which forgets its buffer when the disk is full: what was in it is
/// gone even if space turns up a moment later. This one keeps every event until the kernel has taken it,
/// never leaves half an event behind a whole one, and says how far the disk is.
class LogWriter {
 public:
  struct Options {
    std::size_t write_bytes = 256U << 10U;    ///< handed to the kernel in pieces of at least this
    std::size_t max_held_bytes = 64U << 20U;  ///< kept in memory while the disk takes nothing: about ten
                                              ///< minutes of both streams at full rate
    /// Called when the disk is full; true when something was freed and writing is worth another try.
    std::function<bool()> make_room;
  };

  /// Creates the file, which must not exist yet. Throws std::system_error.
  LogWriter(const std::filesystem::path& path, Options options);
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;
  /// Flushes, without sync.
  ~LogWriter();

  /// Never blocks on a healthy disk beyond a write into the page cache. False when the event was lost: the
  /// disk takes nothing and the memory is used up.
  bool append(std::string_view channel, std::int64_t utime_us, std::span<const std::uint8_t> data);

  /// Hands everything to the kernel. False: the disk did not take it all; what remains is kept and is tried
  /// again by the next call.
  bool flush();
  /// flush(), and waits until it is on the disk.
  bool sync();

  [[nodiscard]] std::uint64_t size_bytes() const noexcept { return written_bytes_ + held_.size(); }
  [[nodiscard]] std::uint64_t synced_bytes() const noexcept { return synced_bytes_; }
  [[nodiscard]] std::size_t held_bytes() const noexcept { return held_.size(); }
  [[nodiscard]] std::uint64_t lost_events() const noexcept { return lost_events_; }
  /// Of the last flush or sync; empty when it succeeded.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
  Options options_;
  int fd_ = -1;
  std::vector<std::uint8_t> held_;
  std::int64_t events_ = 0;
  std::uint64_t written_bytes_ = 0;
  std::uint64_t synced_bytes_ = 0;
  std::uint64_t lost_events_ = 0;
  std::string error_;
};

}  // namespace isorig::messages
