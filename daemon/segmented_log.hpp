#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <isorig_msgs/run_header_t.hpp>
#include <isorig_msgs/session_mark_t.hpp>
#include <memory>
#include <span>
#include <string>

#include "daemon/recorder.hpp"
#include "daemon/run_directory.hpp"
#include "messages/channels.hpp"
#include "messages/log_writer.hpp"

namespace isorig::daemon {

/// A run's directory as one log: segments that each begin with the run's header, a new one for each session
/// and where one grows too large; and the state of the disk under it.
class SegmentedLog {
 public:
  /// `fill` puts the recorder's counters into a session mark. Throws as Recorder does.
  SegmentedLog(RecorderOptions options, const RunInfo& info,
               std::function<void(isorig_msgs::session_mark_t&)> fill);

  /// Messages in order of time. A session that is newer than the present one ends that and begins a segment.
  void append(messages::Channel channel, std::int32_t session, std::int64_t mono_ns,
              std::span<const std::uint8_t> data);
  void end_session(bool complete);
  void sync();
  void roll_if_large();

  [[nodiscard]] DiskCondition condition() const;
  void describe(RecorderStatus& status) const;
  [[nodiscard]] std::int32_t attempt() const noexcept { return header_.attempt; }
  [[nodiscard]] std::int32_t session() const noexcept { return session_; }
  /// False: the last sync left something behind.
  [[nodiscard]] bool synced() const noexcept { return log_->held_bytes() == 0 && log_->error().empty(); }

  std::function<void(const SessionChange&)> on_session;

 private:
  void open_segment();
  bool next_segment();
  void put(messages::Channel channel, std::int64_t mono_ns, std::span<const std::uint8_t> data);
  template <typename Message>
  void put_message(messages::Channel channel, std::int64_t mono_ns, const Message& message);
  void put_mark(std::int8_t kind, bool complete, std::int64_t mono_ns);

  RecorderOptions options_;
  std::function<void(isorig_msgs::session_mark_t&)> fill_;
  RunLock lock_;
  Reserve reserve_;
  bool reserve_given_up_ = false;
  isorig_msgs::run_header_t header_;
  std::unique_ptr<messages::LogWriter> log_;
  int segment_ = 0;
  std::string segment_error_;
  std::uint64_t closed_bytes_ = 0;
  std::uint64_t closed_lost_ = 0;
  std::uint64_t free_bytes_ = 0;
  std::int32_t session_ = -1;
  std::int64_t marks_ = 0;
  std::int64_t last_mono_ns_;
  std::int64_t last_utime_us_ = 0;
};

}  // namespace isorig::daemon
