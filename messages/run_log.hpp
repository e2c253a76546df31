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
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "messages/channels.hpp"
#include "messages/log_reader.hpp"
#include "messages/read_report.hpp"
#include "messages/segment_files.hpp"

/// Reading a run's directory: its segments in order, their messages decoded.
namespace isorig::messages {

/// chain_t's name for what stood behind the last whole message of the segment before.
inline constexpr std::string_view kTornBytes = "torn_bytes";

/// A recording of a version that this program does not know. None of it is read: what it means may have changed, not
/// only how it is laid out.
class UnknownLogVersion : public std::runtime_error {
 public:
  UnknownLogVersion(const std::filesystem::path& segment, std::string_view format);
};

/// What a segment says about its run; nothing when it was cut before that. Throws UnknownLogVersion.
[[nodiscard]] std::optional<isorig_msgs::run_header_t> read_header(const std::filesystem::path& segment,
                                                                   Checksums checksums = Checksums::kAsFound);

/// How the first segment in a run's folder is to be read. A power cut may leave it without a message whose checksum is
/// right; it is one without checksums only when its header can be read and names another format than today's. A single
/// file is not asked: one that `lcm-logger` made of a replayed recording has that header and no right checksum.
[[nodiscard]] Checksums checksums_of_first(const std::filesystem::path& segment);

/// How the segment behind this one is to be read, which was to be read by `its`. A power cut may leave a segment of
/// which no message is whole: by itself it looks like one of a time without checksums, and zeros would be read as what
/// was measured.
[[nodiscard]] Checksums checksums_behind(const std::filesystem::path& segment, Checksums its);

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
/// std::runtime_error when there is no segment, and UnknownLogVersion. `on_progress` is told now and then which part of
/// all bytes was read.
ReadReport read_run(const std::filesystem::path& run_dir, RunVisitor& visitor,
                    const std::function<void(double fraction)>& on_progress = {});

/// Counts what a live subscriber missed of one channel: give it every message's number. Networks reorder (LCM's ttl >
/// 0): a message that comes up to kMostLate messages late is taken back from the count. A larger step back is a new
/// publisher's; so is a smaller one to 0, which all begin with, when no greater number follows than was there before.
class GapCounter {
 public:
  static constexpr std::int64_t kMostLate = 64;

  /// What this message changes the count of missed messages by: how many were skipped before it, or -1 for a late one
  /// that had been counted as missed.
  std::int64_t next(std::int64_t number) noexcept {
    if (number < 0) return 0;  // no publisher's: they count from 0
    const bool zero_came_again = std::exchange(zero_came_again_, false);
    if (newest_ < 0) {  // what was sent before somebody subscribed is not missed
      newest_ = number;
      return 0;
    }
    if (newest_ - number > kMostLate) return begin(number);
    if (zero_came_again && 0 < number && number <= newest_) begin(0);
    if (number > newest_) {
      const std::int64_t step = number - newest_, gap = step - 1;
      missed_ = (step < kMostLate ? missed_ << step : 0) | lowest(gap);
      newest_ = number;
      return gap;
    }
    if (number == newest_) return 0;
    const std::uint64_t bit = std::uint64_t{1} << (newest_ - number - 1);
    if ((missed_ & bit) == 0) {
      zero_came_again_ = number == 0;
      return 0;
    }
    missed_ &= ~bit;
    return -1;
  }

 private:
  std::int64_t begin(std::int64_t number) noexcept {
    newest_ = number;
    missed_ = lowest(number);
    return number;
  }
  static constexpr std::uint64_t lowest(std::int64_t bits) noexcept {
    return bits < kMostLate ? (std::uint64_t{1} << bits) - 1 : ~std::uint64_t{0};
  }

  std::int64_t newest_ = -1;
  std::uint64_t missed_ = 0;  ///< bit k: newest_ - 1 - k did not come
  bool zero_came_again_ = false;
};

}  // namespace isorig::messages
