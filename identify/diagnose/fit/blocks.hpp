#pragma once
#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "identify/diagnose/fit/series.hpp"

namespace isorig::identify {

/// What the recordings are cut into, to be left out of a fit and predicted.
enum class BlockKind {
  kNone,             ///< too little to leave anything out
  kMoves,            ///< from one rest to the next (moves.hpp)
  kStrokes,          ///< from one turning point of the motion to the next
  kPressureStrokes,  ///< from one turning point of the pressure to the next, where the motion stands still
  kStretches,        ///< equal stretches of time
};
[[nodiscard]] std::string_view name_of(BlockKind kind) noexcept;

struct Blocks {
  BlockKind kind = BlockKind::kNone;
  std::vector<std::size_t> of_bin;  ///< bins of all series in a row; never decreasing
  std::size_t count = 0;
};

/// Moves where at least four of them move; else strokes, where there are at least eight; else eight equal stretches of
/// time, shared among the recordings by their length. Every recording begins a new block. None where fewer than five
/// bins a stretch have readings: every block would hang on single readings.
[[nodiscard]] Blocks blocks_of(std::span<const Series> series);

/// Strokes of the motion, or of the pressure where the motion stands still; a hold belongs to the stroke before it. A
/// turning point is where the signal has come back by more than a twentieth of its range and ten times its noise: what
/// is smaller is a ripple. Every recording begins a new stroke; one that turns nowhere is one stroke.
[[nodiscard]] Blocks strokes_of(std::span<const Series> series);

}  // namespace isorig::identify
