#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <isorig_msgs/control_batch_t.hpp>
#include <isorig_msgs/event_t.hpp>
#include <isorig_msgs/exchange_batch_t.hpp>
#include <isorig_msgs/sync_check_t.hpp>
#include <isorig_msgs/frame_average_batch_t.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/pressure_average_batch_t.hpp>
#include <isorig_msgs/pressure_batch_t.hpp>
#include <isorig_msgs/run_header_t.hpp>
#include <isorig_msgs/session_mark_t.hpp>
#include <optional>
#include <string>
#include <vector>

#include "messages/channels.hpp"
#include "messages/log_reader.hpp"

/// Reading a run's directory: its segments in order, their messages decoded.
namespace isorig::messages {

[[nodiscard]] std::string segment_name(int number);                      ///< "segment-0001.lcm"
[[nodiscard]] int segment_number(const std::filesystem::path& segment);  ///< 0 for any other name
[[nodiscard]] std::vector<std::filesystem::path> list_segments(const std::filesystem::path& run_dir);
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

struct ReadReport {
  std::size_t segments = 0;
  std::uint64_t bytes = 0;
  std::uint64_t events = 0;
  std::vector<LogDamage> damage;
  std::uint64_t undecodable = 0;  ///< whole events of our channels that are not what they should be
  std::uint64_t foreign = 0;      ///< events of other channels
  std::array<std::uint64_t, kChannels> missing{};  ///< messages, by the gaps in a channel's numbers

  /// Nothing missing, cut or undecodable.
  [[nodiscard]] bool whole() const noexcept;
  /// One sentence for each thing that is not whole.
  [[nodiscard]] std::vector<std::string> complaints() const;
};

/// Throws std::runtime_error when the directory has no segments. Damage is reported, not thrown.
ReadReport read_run(const std::filesystem::path& run_dir, RunVisitor& visitor);

/// Counts what a subscriber (or a reader) missed of one channel: give it every message's number.
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
