#pragma once
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <isorig_msgs/run_header_t.hpp>
#include <isorig_msgs/session_mark_t.hpp>
#include <map>
#include <optional>
#include <string>

#include "messages/read_report.hpp"

/// What a recording says about its run, for a catalogue that lacks it.
namespace isorig::daemon {

inline constexpr const char* kInterruptedFault = "the process ended without closing the run";

struct RecordingSummary {
  isorig_msgs::run_header_t header;  ///< of the last attempt
  struct Session {
    std::optional<isorig_msgs::session_mark_t> begin, end;  ///< the last of each
    bool complete = false;                                  ///< in any attempt
    std::string segment;
    std::int64_t newest_mono_ns = 0;  ///< of what was measured since it began

    /// Its end, or what was measured last where it has none; 0 before it began.
    [[nodiscard]] std::int64_t last_mono_ns() const noexcept {
      if (end) return end->mono_ns;
      return begin ? std::max(begin->mono_ns, newest_mono_ns) : 0;
    }
  };
  std::map<std::int32_t, Session> sessions;
  messages::ReadReport report;
  std::string started_utc;    ///< of run.toml
  std::string operator_name;  ///< empty where nobody was named
  std::string outcome;        ///< how the last attempt ended, as its own events say; empty: they do not
  std::string outcome_text;   ///< and why

  /// As a catalogue has it: done, aborted, failed, not started or interrupted. Done is only what is whole.
  [[nodiscard]] std::string run_state() const;
  /// What the catalogue says of a run that was not done; empty for one that was.
  [[nodiscard]] std::string run_fault() const;
};

/// Throws when there is nothing to be read.
[[nodiscard]] RecordingSummary summarize_recording(const std::filesystem::path& run_dir);

/// The input files in the run's header, by name; empty when it has none that can be read.
[[nodiscard]] std::map<std::string, std::string> recorded_texts(const std::filesystem::path& run_dir);

}  // namespace isorig::daemon
