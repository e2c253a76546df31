#pragma once
#include <string>

#include "daemon/core/core.hpp"

/// What the daemon says to the journal and to `systemctl status`.
namespace isorig::daemon {

/// What an operator finds in the journal the morning after; single steps are in the recording.
void log_event(const EventRecord& e);
/// The line of `systemctl status`.
[[nodiscard]] std::string status_line(const Status& s, const std::string& run);

}  // namespace isorig::daemon
