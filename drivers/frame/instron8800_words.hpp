#pragma once
#include <cstdint>
#include <string>
#include <string_view>

/// What the files of the driver for Instron's 8800 family have in common.
namespace isorig::frame {

inline constexpr std::int64_t kMs = 1'000'000;
/// Q1's answer while the crosshead moves; what else it says is some way of standing.
inline constexpr double kQ1Moving = 1.0;
/// Two positions that say whether the crosshead stands are read at least this far apart.
inline constexpr std::int64_t kStandstill_ns = 20 * kMs;
/// Positions further apart than this are not interpolated between: a hang lay there.
inline constexpr std::int64_t kFarApart_ns = 250 * kMs;
/// A stop that is not confirmed is sent again so often.
inline constexpr std::int64_t kStopAgain_ns = 100 * kMs;
/// A poll() that finds no sample returns after this.
inline constexpr std::int64_t kSlice_ns = 20 * kMs;

/// The begin of a line, for a sentence.
[[nodiscard]] inline std::string in_quotes(std::string_view line) {
  return "\"" + std::string(line.substr(0, 60)) + "\"";
}

}  // namespace isorig::frame
