#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <isorig_msgs/chain_t.hpp>
#include <isorig_msgs/run_header_t.hpp>
#include <isorig_msgs/session_mark_t.hpp>
#include <memory>
#include <span>
#include <string>

#include "daemon/recording/recorder_types.hpp"
#include "daemon/recording/run_directory.hpp"
#include "messages/channels.hpp"
#include "messages/log_writer.hpp"

namespace isorig::daemon {

/// A run's directory as one log: segments that each begin with the run's header, a new one for each session
/// and where one grows too large; and the state of the disk under it.
///
/// Nothing here throws once it is constructed, but std::bad_alloc: what the disk does not take is held and tried again
/// with the next sync, and condition() says so.
class SegmentedLog {
 public:
  /// `fill` puts the recorder's counters into a session mark. Throws as Recorder does.
  SegmentedLog(RecorderOptions options, const RunInfo& info, std::function<void(isorig_msgs::session_mark_t&)> fill);

  /// Messages in order of time. A session that is newer than the present one ends that and begins a segment.
  void append(messages::Channel channel, std::int32_t session, std::int64_t mono_ns,
              std::span<const std::uint8_t> data);
  /// Something of the present session never came here: it will not be complete.
  void note_loss() noexcept { session_lossless_ = false; }
  void end_session(bool complete);
  /// The mark without which a recording counts as interrupted. Nothing may follow but sync().
  void end_attempt(bool complete, std::uint64_t dropped_records);
  void sync();
  void roll_if_large();
  /// Tells on_session what is on the disk by now, in order. What it throws is kept for the next call.
  void tell_sessions();

  [[nodiscard]] DiskCondition condition() const;
  void describe(RecorderStatus& status) const;
  [[nodiscard]] std::int32_t attempt() const noexcept { return header_.attempt; }
  [[nodiscard]] std::int32_t session() const noexcept { return session_; }
  /// False: the last sync left something behind.
  [[nodiscard]] bool synced() const noexcept {
    return log_->held_bytes() == 0 && log_->error().empty() && segment_error_.empty();
  }
  /// All that on_session is owed was told.
  [[nodiscard]] bool told() const noexcept { return changes_.empty(); }
  /// Why not everything that was written can be vouched for; empty when it can. Stays once it is set.
  [[nodiscard]] const std::string& fault() const noexcept { return fault_; }

  /// A session's end is told after the sync that put it on the disk: a catalogue must not be ahead of the recording.
  std::function<void(const SessionChange&)> on_session;

 private:
  struct Pending {
    SessionChange change;
    bool on_disk = false;
  };

  [[nodiscard]] std::unique_ptr<messages::LogWriter> create_segment();
  void begin_segment(std::unique_ptr<messages::LogWriter> next);
  bool next_segment();
  bool leave_condemned();
  void note_condemned();
  void look_at_space();
  void put(messages::Channel channel, std::int64_t mono_ns, std::span<const std::uint8_t> data);
  template <typename Message>
  void put_message(messages::Channel channel, std::int64_t mono_ns, const Message& message);
  void put_mark(std::int8_t kind, bool complete, std::int64_t mono_ns);
  void put_chain(std::int8_t kind, const messages::LogTally& tally);

  RecorderOptions options_;
  std::function<void(isorig_msgs::session_mark_t&)> fill_;
  RunLock lock_;
  Reserve reserve_;
  bool reserve_given_up_ = false;
  isorig_msgs::run_header_t header_;
  std::unique_ptr<messages::LogWriter> log_;
  messages::LogTally before_;  // of the segment before the present one
  std::filesystem::path before_path_;
  int segment_ = 0;
  std::string segment_error_;
  std::string space_error_;
  std::string catalogue_error_;
  std::string fault_;
  std::uint64_t closed_bytes_ = 0;
  std::uint64_t closed_lost_ = 0;
  std::uint64_t free_bytes_ = 0;
  std::int32_t session_ = -1;
  bool session_lossless_ = true;
  std::deque<Pending> changes_;
  std::int64_t marks_ = 0;
  std::int64_t chain_ = 0;
  std::array<std::int64_t, messages::kChannels> written_{};  // messages of this attempt
  bool ended_ = false;
  bool ended_complete_ = false;
  std::uint64_t dropped_records_ = 0;
  std::int64_t last_mono_ns_;
  std::int64_t last_utime_us_ = 0;
};

}  // namespace isorig::daemon
