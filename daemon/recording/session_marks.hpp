#pragma once
#include <toml++/toml.h>

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "messages/run_log.hpp"

namespace isorig::daemon {

/// What was said beside the samples of one session: its steps and the operator's marks, what happened, what is missing.
struct SessionMarks {
  std::vector<isorig_msgs::event_t> events;
  std::int64_t frame_missing = 0, pressure_missing = 0;  ///< jumps of the devices' counters within it

  /// `steps`, `events` and `missing` of recording.toml; times from `start_ns`.
  void write(toml::table& to, std::int64_t start_ns) const;
};

/// Of a recorded event, as people read it; "?" when the number is none of ours.
[[nodiscard]] const char* severity_text(const isorig_msgs::event_t& event) noexcept;

/// The recorder counts what is missing over an attempt; this says how much of it was a session's.
class MissingCounts {
 public:
  /// Of a session's end mark: frame and pressure since the one before.
  std::pair<std::int64_t, std::int64_t> since_last(const isorig_msgs::session_mark_t& end);

 private:
  std::map<std::int32_t, std::pair<std::int64_t, std::int64_t>> before_;  // by attempt
};

}  // namespace isorig::daemon
