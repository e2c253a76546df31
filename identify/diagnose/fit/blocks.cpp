#include "identify/diagnose/fit/blocks.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {
namespace {

struct Range {
  double low = 1e300, high = -1e300;
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] double width() const { return std::max(high - low, 0.0); }
};

template <typename Value>
Range range_of(const Series& series, Value value) {
  Range range;
  for (const model::Instant& node : series.nodes) range.add(value(node));
  return range;
}

double position(const model::Instant& node) {
  return node.position_mm;
}
double pressure(const model::Instant& node) {
  return node.excess_pressure_psi;
}

bool stands_still(const Series& series) {
  return range_of(series, position).width() <= still_mm(series);
}

/// First bins of the strokes: 0, and where a signal turns.
template <typename Value>
std::vector<std::size_t> turns(const Series& series, double least, Value value) {
  std::vector<std::size_t> first{0};
  std::size_t extreme = 0;  // of the stroke so far, in its direction
  double direction = 0.0, low = value(series.nodes[0]), high = low;
  for (std::size_t k = 1; k < series.nodes.size(); ++k) {
    const double now = value(series.nodes[k]);
    if (direction == 0.0) {
      low = std::min(low, now);
      high = std::max(high, now);
      if (high - low > least) {
        direction = now - low > high - now ? 1.0 : -1.0;
        extreme = k;
      }
      continue;
    }
    if (direction * (now - value(series.nodes[extreme])) >= 0.0) {
      extreme = k;
    } else if (direction * (value(series.nodes[extreme]) - now) > least) {
      first.push_back(extreme);
      direction = -direction;
      extreme = k;
    }
  }
  return first;
}

/// Numbers the bins of a series by where its blocks begin.
void append(Blocks& blocks, const Series& series, std::span<const std::size_t> first) {
  std::size_t next = 0;
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    if (next < first.size() && k == first[next]) {
      ++blocks.count;
      ++next;
    }
    blocks.of_bin.push_back(blocks.count - 1);
  }
}

std::size_t moves_that_move(std::span<const Series> series, const MoveNumbers& moves) {
  std::vector<Range> ranges(moves.count);
  std::size_t row = 0;
  double most_still_mm = 0.0;
  for (const Series& each : series) {
    most_still_mm = std::max(most_still_mm, still_mm(each));
    for (const auto& node : each.nodes) ranges[moves.of_bin[row++]].add(node.position_mm);
  }
  double widest = 0.0;
  for (const Range& range : ranges) widest = std::max(widest, range.width());
  return static_cast<std::size_t>(std::ranges::count_if(ranges, [&](const Range& range) {
    return range.width() > most_still_mm && range.width() >= deciding().least_move_share * widest;
  }));
}

/// `wanted` stretches of equal time.
std::vector<std::size_t> stretches(const Series& series, std::size_t wanted) {
  std::vector<std::size_t> first;
  const double start_s = series.nodes.front().t_s, span_s = series.nodes.back().t_s - start_s;
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const double from_s = start_s + span_s * static_cast<double>(first.size()) / static_cast<double>(wanted);
    if (first.size() < wanted && series.nodes[k].t_s >= from_s) first.push_back(k);
  }
  return first;
}

}  // namespace

std::string_view name_of(BlockKind kind) noexcept {
  switch (kind) {
    case BlockKind::kNone:
      return "none";
    case BlockKind::kMoves:
      return "moves";
    case BlockKind::kStrokes:
      return "strokes";
    case BlockKind::kPressureStrokes:
      return "pressure_strokes";
    case BlockKind::kStretches:
      return "stretches";
  }
  return "";
}

Blocks strokes_of(std::span<const Series> series) {
  Blocks out;
  const bool still = std::ranges::all_of(series, stands_still);
  out.kind = still ? BlockKind::kPressureStrokes : BlockKind::kStrokes;
  const auto value = still ? pressure : position;
  for (const Series& each : series) {
    if (each.nodes.empty()) continue;
    const double noise = still ? each.excitation.pressure_noise_psi : each.excitation.motion.noise_mm;
    append(out, each,
           turns(each,
                 std::max(deciding().least_turn_share * range_of(each, value).width(),
                          deciding().least_turn_noises * noise),
                 value));
  }
  return out;
}

Blocks blocks_of(std::span<const Series> series) {
  const std::size_t stretch_count = deciding().stretches_to_leave_out;
  MoveNumbers moves = number_moves(series);
  if (moves_that_move(series, moves) >= deciding().fewest_moves_to_leave_out)
    return {BlockKind::kMoves, std::move(moves.of_bin), moves.count};
  if (Blocks strokes = strokes_of(series); strokes.count >= deciding().fewest_strokes_to_leave_out) return strokes;
  Blocks out;
  double all_s = 0.0;
  std::size_t bins = 0;
  for (const Series& each : series) {
    all_s += each.nodes.back().t_s - each.nodes.front().t_s;
    bins += static_cast<std::size_t>(std::ranges::count_if(each.count, [](double count) { return count > 0.0; }));
  }
  for (const Series& each : series) {
    const double share = (each.nodes.back().t_s - each.nodes.front().t_s) / std::max(all_s, 1e-300);
    const auto wanted = static_cast<std::size_t>(std::max(1.0, std::round(share * static_cast<double>(stretch_count))));
    append(out, each, stretches(each, wanted));
  }
  if (bins >= stretch_count * deciding().fewest_bins_of_a_stretch && out.count >= 2) {
    out.kind = BlockKind::kStretches;
  } else {
    out = {};
    out.count = 1;
    for (const Series& each : series) out.of_bin.insert(out.of_bin.end(), each.nodes.size(), 0);
  }
  return out;
}

}  // namespace isorig::identify
