#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "messages/channels.hpp"
#include "messages/log_reader.hpp"

namespace isorig::messages {

/// Worse ones are larger.
enum class RecordingState : std::uint8_t {
  kWhole,        ///< every planned repetition to its end, and nothing of the recording is missing or altered
  kIncomplete,   ///< ended in order, but not everything that was planned is in it, or the recorder itself lost some
  kInterrupted,  ///< its end is missing: the writer was killed, or the end was cut off
  kDamaged,      ///< something in it is altered or missing
};
[[nodiscard]] const char* to_text(RecordingState state) noexcept;

/// The numbers of one channel's messages in one attempt. They may come out of order: each has to come once.
class NumberCheck {
 public:
  /// A lone segment may begin with any number.
  void begin_anywhere() noexcept { anywhere_ = true; }
  /// False: it was there before.
  bool take(std::int64_t number);
  [[nodiscard]] std::uint64_t missing() const noexcept { return missing_; }
  [[nodiscard]] std::uint64_t repeated() const noexcept { return repeated_; }

 private:
  bool anywhere_ = false;
  std::int64_t next_ = 0;
  std::map<std::int64_t, std::int64_t> gaps_;  // first missing, and the one after the last missing
  std::uint64_t missing_ = 0;
  std::uint64_t repeated_ = 0;
};

/// What reading a recording found.
struct ReadReport {
  std::size_t segments = 0;
  std::uint64_t bytes = 0;
  std::uint64_t events = 0;
  std::vector<LogDamage> damage;
  std::uint64_t undecodable = 0;                   ///< messages of our channels that are not what they should be
  std::uint64_t foreign = 0;                       ///< messages of other channels
  std::array<std::uint64_t, kChannels> missing{};  ///< messages whose numbers never came
  std::uint64_t repeated = 0;                      ///< messages that came more than once
  std::vector<std::string> contradictions;         ///< segments that are gone, empty or not what they were
  bool has_header = false;
  bool has_checksums = true;          ///< every segment; recordings before format 2 have none
  bool lone_segment = false;          ///< a file was read, not a run: nothing is said about its surroundings
  bool ended = false;                 ///< the last attempt has its end
  std::uint64_t dropped_records = 0;  ///< as the recorder says: lost before it
  std::uint64_t lost_messages = 0;    ///< as the recorder says: the disk took nothing
  std::vector<std::string> faults;    ///< for which the recorder could not vouch for what it wrote
  std::size_t sessions_planned = 0;
  std::vector<std::string> unfinished;  ///< planned repetitions that no attempt carried to their end
  std::vector<std::string> notes;       ///< worth knowing, nothing wrong
  bool still_written = false;           ///< a recorder is at it: no end yet is no fault

  /// What a catalogue says about the run (empty: nothing): one that was closed had its end on the disk before.
  void set_against(const std::string& outcome, bool written_now);

  [[nodiscard]] RecordingState state() const noexcept;
  /// In words; an end that is missing because a recorder is at it is "being written".
  [[nodiscard]] const char* state_text() const noexcept;
  /// Everything that was recorded is here as it was recorded, and the recorder lost nothing. The plan may have been
  /// stopped before its end all the same.
  [[nodiscard]] bool whole() const noexcept;
  /// A sentence for each thing that is not as it should be.
  [[nodiscard]] std::vector<std::string> complaints() const;
  /// Messages whose numbers never came, of all channels, without those that the recorder itself counts as lost.
  [[nodiscard]] std::uint64_t gone() const noexcept;
};

}  // namespace isorig::messages
