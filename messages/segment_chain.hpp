#pragma once
#include <filesystem>
#include <isorig_msgs/chain_t.hpp>
#include <string>
#include <vector>

#include "messages/log_reader.hpp"
#include "messages/read_report.hpp"

namespace isorig::messages {

/// A segment as it was read, for what the segment after it says of it.
struct SegmentBefore {
  std::filesystem::path path;
  LogTally tally;
  bool altered = false;  ///< known already to be damaged, or to have lost messages
};

/// The first chain message of segment `name` states how many messages and bytes the segment before held when `name` was
/// begun, their checksum, and how many bytes of no whole message stood behind them. Compares that with what was read of
/// `before`, and adds what differs to the report. `torn`: ends of segments that are no whole message. Those that the
/// writer knew of when it went on lost nothing, and are removed.
void compare_with_before(const isorig_msgs::chain_t& says, const SegmentBefore& before, const std::string& name,
                         std::vector<LogDamage>& torn, ReadReport& report);

}  // namespace isorig::messages
