#pragma once
#include <optional>

#include "cli/rig/client.hpp"

namespace isorig::cli {

/// Whether there is a terminal at which a person can be asked.
[[nodiscard]] bool someone_is_there();

/// Where the rig is armed: asks the person at the terminal whether everybody is clear, and gives the second act. The
/// daemon's answer to that, or a refusal; nothing when the rig is not armed. Without a person the rig is disarmed.
[[nodiscard]] std::optional<Answer> second_act(const Client& client);

}  // namespace isorig::cli
