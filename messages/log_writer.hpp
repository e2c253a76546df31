#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/log_event.hpp"

namespace isorig::messages {

/// Writes one LCM event log (messages/log_event.hpp), a checksum behind each message.
///
/// liblcm's own writer goes through stdio, which forgets its buffer when the disk is full: what was in it is
/// gone even if space turns up a moment later. This one keeps every event until the kernel has taken it,
/// never leaves half an event behind a whole one, and says how far the disk is.
///
/// A sync that fails is final: the kernel marks pages clean whose writing failed, so that a later sync "succeeds"
/// although they never reached the disk (Rebello et al., "Can applications recover from fsync failures?", USENIX ATC
/// 2020). Such a file is condemned: it takes nothing more, and what was not handed to the kernel yet stays here for
/// another file (hand_over).
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

  /// A sync failed, or the file was removed: what was written since the last sync that succeeded may be gone.
  [[nodiscard]] bool condemned() const noexcept { return condemned_; }
  /// Every event that the kernel has not taken whole, in order; they are forgotten here.
  void hand_over(const std::function<void(std::string_view channel, std::int64_t utime_us,
                                          std::span<const std::uint8_t> data)>& to);

  [[nodiscard]] std::uint64_t size_bytes() const noexcept { return written_bytes_ + held_bytes(); }
  [[nodiscard]] std::uint64_t synced_bytes() const noexcept { return synced_bytes_; }
  [[nodiscard]] std::size_t held_bytes() const noexcept { return held_.size() - begun_bytes_; }
  /// All events that were appended, without those handed over.
  [[nodiscard]] const LogTally& tally() const noexcept { return tally_; }
  /// Those of them that the kernel has taken whole.
  [[nodiscard]] const LogTally& written_tally() const noexcept { return written_tally_; }
  [[nodiscard]] std::uint64_t lost_events() const noexcept { return lost_events_; }
  /// Of the last flush or sync; empty when it succeeded. Of a condemned file: why.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
  Options options_;
  int fd_ = -1;
  std::vector<std::uint8_t> held_;  // whole events
  std::size_t begun_bytes_ = 0;     // of the first of them: written already
  LogTally tally_;                  // of all events, and
  LogTally written_tally_;          // of those that the kernel has whole
  bool condemned_ = false;
  std::uint64_t written_bytes_ = 0;
  std::uint64_t synced_bytes_ = 0;
  std::uint64_t lost_events_ = 0;
  std::string error_;
};

}  // namespace isorig::messages
