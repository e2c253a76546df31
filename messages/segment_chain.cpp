#include "messages/segment_chain.hpp"

#include <limits>

#include "messages/run_log.hpp"

namespace isorig::messages {
namespace {

std::int64_t torn_bytes(const std::vector<LogDamage>& torn) {
  std::uint64_t bytes = 0;
  for (const auto& d : torn) bytes += d.bytes;
  return static_cast<std::int64_t>(bytes);
}

/// Recordings from before this was written down say nothing: then any number is right.
std::int64_t torn_bytes_due(const isorig_msgs::chain_t& says) {
  for (std::size_t k = 0; k < says.channels.size() && k < says.messages.size(); ++k) {
    if (says.channels[k] == kTornBytes) return says.messages[k];
  }
  return std::numeric_limits<std::int64_t>::max();
}

}  // namespace

void compare_with_before(const isorig_msgs::chain_t& says, const SegmentBefore& before, const std::string& name,
                         std::vector<LogDamage>& torn, ReadReport& report) {
  const std::int64_t torn_now = torn_bytes(torn), torn_due = torn_bytes_due(says);
  const LogTally due{says.events, says.bytes, static_cast<std::uint32_t>(says.checksum)};
  const auto& is = before.tally;
  const auto held = before.path.filename().string();
  if (is == due && torn_now > torn_due) {
    report.contradictions.push_back(held + " has " + std::to_string(torn_now) +
                                    " bytes behind its last whole message; when " + name + " was begun it had " +
                                    std::to_string(torn_due));
  } else if (is == due) {
    // What was torn when the writer went on behind it is known, and lost nothing that anybody was told to be there.
    for (const auto& d : torn) {
      if (d.bytes > 0)
        report.notes.push_back(d.file.string() + ": the last " + std::to_string(d.bytes) +
                               " bytes are no whole message, and were known to be none when " + name + " was begun");
    }
    torn.clear();
  } else if (!before.altered) {
    report.contradictions.push_back(held + " holds " + std::to_string(is.events) + " messages in " +
                                    std::to_string(is.bytes) + " bytes; when " + name + " was begun it held " +
                                    std::to_string(due.events) + " in " + std::to_string(due.bytes) +
                                    (is.events == due.events ? ", others" : ""));
  }
}

}  // namespace isorig::messages
