#pragma once
#include <cstdint>

#include "messages/recording.hpp"

namespace isorig::messages {

/// FNV-1a (Fowler, Noll & Vo) over time, position and force of every row: equal for copies of one recording, whatever
/// their folder is called.
[[nodiscard]] std::uint64_t fingerprint(const Recording& recording);

/// The fingerprint as a whole number from 2 to 2^53 - 1, which a double and a TOML float hold exactly. It ties the
/// event of a recording (a slip, what filling left) to that recording: in a million recordings two share an
/// id with odds of 1 in 18 000.
[[nodiscard]] double recording_id(const Recording& recording);

}  // namespace isorig::messages
