#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::messages {

/// FNV-1a (Fowler, Noll & Vo) over time, position and force of every row: equal for copies of one recording, whatever
/// their folder is called.
[[nodiscard]] std::uint64_t fingerprint(const Recording& recording);

/// The fingerprint as a whole number from 2 to 2^53 - 1, which a double and a TOML float hold exactly. It ties the
/// event of a recording (a slip, what filling left) to that recording: in a million recordings two share an
/// id with odds of 1 in 18 000.
[[nodiscard]] double recording_id(const Recording& recording);

/// What tells that two recordings hold the same readings although their times, or their first and last rows, differ:
/// one session exported by two clocks, a copy that lost a row, two cuts that overlap. Hashes of windows of 32 rows of
/// position and force that move, one of 64 windows, chosen by its own hash (winnowing; Schleimer, Wilkerson & Aiken
/// 2003), so that equal rows have equal marks wherever they stand. Sorted.
[[nodiscard]] std::vector<std::uint64_t> reading_marks(const Recording& recording);

/// More than half of the marks of the shorter one, four at least, are in the other: read independently, the noise of 32
/// readings does not come twice.
[[nodiscard]] bool share_readings(std::span<const std::uint64_t> a, std::span<const std::uint64_t> b);

}  // namespace isorig::messages
