#include "messages/read_report.hpp"

#include <algorithm>
#include <numeric>

namespace isorig::messages {

const char* to_text(RecordingState state) noexcept {
  switch (state) {
    case RecordingState::kWhole:
      return "whole";
    case RecordingState::kIncomplete:
      return "incomplete";
    case RecordingState::kInterrupted:
      return "interrupted";
    case RecordingState::kDamaged:
      return "damaged";
  }
  return "";
}

bool NumberCheck::take(std::int64_t number) {
  if (anywhere_) {
    anywhere_ = false;
    next_ = number;
  }
  if (number >= next_) {
    if (number > next_) {
      gaps_.emplace(next_, number);
      missing_ += static_cast<std::uint64_t>(number - next_);
    }
    next_ = number + 1;
    return true;
  }
  auto gap = gaps_.upper_bound(number);
  if (gap == gaps_.begin() || (--gap)->second <= number) {
    ++repeated_;
    return false;
  }
  const auto [from, to] = *gap;
  gaps_.erase(gap);
  if (from < number) gaps_.emplace(from, number);
  if (number + 1 < to) gaps_.emplace(number + 1, to);
  --missing_;
  return true;
}

RecordingState ReadReport::state() const noexcept {
  const bool altered = std::any_of(damage.begin(), damage.end(), [](const auto& d) { return !d.at_end; });
  if (altered || undecodable > 0 || repeated > 0 || !contradictions.empty() || gone() > 0) {
    return RecordingState::kDamaged;
  }
  if (!damage.empty() || (!ended && !lone_segment)) return RecordingState::kInterrupted;
  const bool all = unfinished.empty() && dropped_records == 0 && lost_messages == 0 && faults.empty();
  return all ? RecordingState::kWhole : RecordingState::kIncomplete;
}

std::uint64_t ReadReport::gone() const noexcept {
  const auto all = std::accumulate(missing.begin(), missing.end(), std::uint64_t{0});
  return all > lost_messages ? all - lost_messages : 0;
}

const char* ReadReport::state_text() const noexcept {
  const auto is = state();
  return is == RecordingState::kInterrupted && still_written ? "being written" : to_text(is);
}

bool ReadReport::whole() const noexcept {
  return state() <= RecordingState::kIncomplete && dropped_records == 0 && lost_messages == 0 && faults.empty();
}

void ReadReport::set_against(const std::string& outcome, bool written_now) {
  still_written = written_now;
  if (written_now || ended || lone_segment) return;
  if (outcome == "done" || outcome == "aborted" || outcome == "failed") {
    contradictions.push_back("the catalogue has the run as " + outcome + ", and the recording's end is gone");
  }
}

std::vector<std::string> ReadReport::complaints() const {
  std::vector<std::string> lines;
  for (const auto& d : damage) {
    if (d.bytes == 0) {
      lines.push_back(d.file.string() +
                      " is empty: its writer was interrupted before its first message, or it was emptied");
      continue;
    }
    lines.push_back(d.file.string() + ": " + std::to_string(d.bytes) + " bytes at " + std::to_string(d.offset) +
                    (d.at_end ? " are no whole message: the writer was interrupted, or the end was cut off"
                              : " are not as they were written, and were left out"));
  }
  lines.insert(lines.end(), contradictions.begin(), contradictions.end());
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (missing[i] > 0) {
      lines.push_back(std::to_string(missing[i]) + " messages are missing on " + std::string(kChannelNames[i]));
    }
  }
  if (repeated > 0) lines.push_back(std::to_string(repeated) + " messages are in the recording more than once");
  if (undecodable > 0) {
    lines.push_back(std::to_string(undecodable) + " messages could not be decoded: damaged, or of another version");
  }
  if (!ended && !lone_segment) {
    lines.push_back(still_written ? "the recording is being written and has no end yet"
                                  : "the recording has no end: its writer was interrupted, or the end was cut off");
  }
  if (dropped_records > 0) {
    lines.push_back(std::to_string(dropped_records) +
                    " records were dropped before the recorder, which was not scheduled in time or waited for the "
                    "disk; the events named recorder.dropped say when");
  }
  if (lost_messages > 0) {
    lines.push_back(std::to_string(lost_messages) +
                    " messages were lost by the recorder: the disk took nothing and the memory was used up");
  }
  for (const auto& fault : faults) lines.push_back("the recorder could not vouch for what it wrote: " + fault);
  if (!unfinished.empty()) {
    constexpr std::size_t kNamed = 4;
    std::string line = std::to_string(unfinished.size()) + " of " + std::to_string(sessions_planned) +
                       " planned repetitions were not carried to their end: ";
    for (std::size_t i = 0; i < std::min(unfinished.size(), kNamed); ++i) line += (i > 0 ? ", " : "") + unfinished[i];
    lines.push_back(line + (unfinished.size() > kNamed ? ", ..." : ""));
  }
  return lines;
}

}  // namespace isorig::messages
