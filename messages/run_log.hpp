#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <isorig_msgs/chain_t.hpp>
#include <isorig_msgs/control_batch_t.hpp>
#include <isorig_msgs/event_t.hpp>
#include <isorig_msgs/exchange_batch_t.hpp>
#include <isorig_msgs/frame_average_batch_t.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/pressure_average_batch_t.hpp>
#include <isorig_msgs/pressure_batch_t.hpp>
#include <isorig_msgs/run_header_t.hpp>
#include <isorig_msgs/session_mark_t.hpp>
#include <isorig_msgs/sync_check_t.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "messages/channels.hpp"
#include "messages/log_reader.hpp"
#include "messages/read_report.hpp"
#include "messages/segment_files.hpp"

/// Reading a run's directory: its segments in order, their messages decoded.
namespace isorig::messages {

/// chain_t's name for what stood behind the last whole message of the segment before.
inline constexpr std::string_view kTornBytes = "torn_bytes";

/// What a segment says about its run; nothing when it was cut before that.
[[nodiscard]] std::optional<isorig_msgs::run_header_t> read_header(const std::filesystem::path& segment);

/// Gets what a run holds, in the order it was written. Override what is of interest; the rest is not decoded
/// in vain, but counted.
class RunVisitor {
 public:
  virtual ~RunVisitor() = default;
  virtual void segment(const std::filesystem::path&) {}
  virtual void header(const isorig_msgs::run_header_t&) {}
  virtual void session(const isorig_msgs::session_mark_t&) {}
  virtual void frame(const isorig_msgs::frame_batch_t&) {}
  virtual void pressure(const isorig_msgs::pressure_batch_t&) {}
  virtual void frame_average(const isorig_msgs::frame_average_batch_t&) {}
  virtual void pressure_average(const isorig_msgs::pressure_average_batch_t&) {}
  virtual void control(const isorig_msgs::control_batch_t&) {}
  virtual void event(const isorig_msgs::event_t&) {}
  virtual void exchanges(const isorig_msgs::exchange_batch_t&) {}
  virtual void sync(const isorig_msgs::sync_check_t&) {}
};

/// Of a run's directory, or of one segment. What is altered or cut is left out and reported. Throws
/// std::runtime_error when there is no segment. `on_progress` is told now and then which part of all bytes was read.
ReadReport read_run(const std::filesystem::path& run_dir, RunVisitor& visitor,
                    const std::function<void(double fraction)>& on_progress = {});

/// Counts what a live subscriber missed of one channel: give it every message's number.
class GapCounter {
 public:
  /// How many were missed before this one. Numbers that begin again are a new publisher's.
  std::uint64_t next(std::int64_t number) noexcept {
    std::int64_t gap = 0;
    if (seen_ && number > last_) gap = number - last_ - 1;
    if (seen_ && number < last_) gap = number;  // a new publisher, of whom we missed the first
    seen_ = true;
    last_ = number;
    return static_cast<std::uint64_t>(gap);
  }

 private:
  bool seen_ = false;
  std::int64_t last_ = 0;
};

}  // namespace isorig::messages
