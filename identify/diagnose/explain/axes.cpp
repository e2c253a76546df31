#include "identify/diagnose/explain/axes.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify {
namespace {

Cells by_quantile(const std::vector<double>& value, int count) {
  std::vector<double> sorted = value;
  std::ranges::sort(sorted);
  std::vector<double> edges{sorted.front()};
  for (int c = 1; c < count; ++c) edges.push_back(sorted[sorted.size() * static_cast<std::size_t>(c) / count]);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Cells cells{{}, static_cast<int>(edges.size()), static_cast<int>(edges.size()), {}};
  for (const double v : value)
    cells.cell.push_back(static_cast<int>(std::upper_bound(edges.begin(), edges.end(), v) - edges.begin()) - 1);
  edges.push_back(sorted.back());
  cells.edges = std::move(edges);
  return cells;
}

Cells by_edges(const std::vector<double>& value, std::vector<double> edges) {
  const int count = static_cast<int>(edges.size()) - 1;
  Cells cells{{}, count, count, {}};
  for (const double v : value)
    cells.cell.push_back(std::clamp(
        static_cast<int>(std::upper_bound(edges.begin(), edges.end(), v) - edges.begin()) - 1, 0, count - 1));
  cells.edges = std::move(edges);
  return cells;
}

/// Which way the velocity changed at the last corner: from how it was in the middle of the stretch before the
/// corner to how it is in the middle of the one after.
std::vector<int> turns(const std::vector<int>& direction, const std::vector<double>& since) {
  std::vector<std::size_t> corners{0};
  for (std::size_t i = 1; i < since.size(); ++i)
    if (since[i] < since[i - 1]) corners.push_back(i);
  corners.push_back(since.size());
  std::vector<int> out(since.size(), 1);
  int before = 1;
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const int after = direction[(corners[c] + corners[c + 1]) / 2];
    const int turn = 1 + (after > before) - (after < before);
    for (std::size_t i = corners[c]; i < corners[c + 1]; ++i) out[i] = turn;
    before = after;
  }
  return out;
}

/// Apart by one of three groups: 0 towards shortening, 1 neither, 2 towards lengthening.
Cells with_group(Cells cells, const std::vector<int>& group) {
  for (std::size_t i = 0; i < group.size(); ++i) cells.cell[i] += cells.count * group[i];
  cells.count *= 3;
  return cells;
}

/// Direction of the last motion; it stays the same in a hold, as friction does. The end of a ramp overshoots by some
/// noises of the reading, and there the reconstructed velocity varies by more than that of a slow return: only a
/// displacement of a thousandth of the whole stroke or more counts as a turn.
std::vector<int> last_directions(std::span<const Series> series, const std::vector<double>& position_mm) {
  constexpr double kTurnShare = 1e-3, kTurnNoises = 10.0;
  const auto [lowest_mm, highest_mm] = std::ranges::minmax(position_mm);
  std::vector<int> out;
  for (const Series& each : series) {
    const double turn_mm =
        std::max(kTurnShare * (highest_mm - lowest_mm), kTurnNoises * each.excitation.motion.noise_mm);
    double follower_mm = each.nodes.front().position_mm;
    int last = 1;
    for (const auto& node : each.nodes) {
      const double before_mm = follower_mm;
      follower_mm = std::clamp(follower_mm, node.position_mm - 0.5 * turn_mm, node.position_mm + 0.5 * turn_mm);
      if (follower_mm != before_mm) last = follower_mm > before_mm ? 2 : 0;
      out.push_back(last);
    }
  }
  return out;
}

}  // namespace

Covariates covariates_of(std::span<const Series> series) {
  Covariates out;
  double start_s = 0.0, fastest_mm_s = 1e-9;
  for (const Series& each : series) {
    double travelled_mm = 0.0;
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      const auto& node = each.nodes[k];
      travelled_mm += std::fabs(node.step_mm);
      out.time_s.push_back(start_s + node.t_s);
      out.position_mm.push_back(node.position_mm);
      out.strain_percent.push_back(100.0 * series[0].recording.strain(node.position_mm));
      out.rate_mm_s.push_back(node.velocity_mm_s);
      out.since_s.push_back(each.since_corner_s[k]);
      out.travel_mm.push_back(travelled_mm);
      out.pressure_psi.push_back(node.excess_pressure_psi);
      out.readings.push_back(each.count[k]);
      fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
    }
    start_s += each.nodes.back().t_s + 1.0;
  }
  const double still_mm_s = 3e-4 * fastest_mm_s;
  for (const double rate : out.rate_mm_s) out.direction.push_back(rate > still_mm_s ? 2 : rate < -still_mm_s ? 0 : 1);
  out.last_direction = last_directions(series, out.position_mm);
  out.moves = number_moves(series);
  return out;
}

std::vector<Axis> axes_of(const Covariates& of, bool several_recordings) {
  std::vector<Axis> axes;
  axes.push_back({"position", by_quantile(of.position_mm, 60), " mm", ""});
  // Without a rest length there is no strain.
  if (std::ranges::all_of(of.strain_percent, [](double strain) { return std::isfinite(strain); }))
    axes.push_back({"strain", by_quantile(of.strain_percent, 10), " %", ""});
  axes.push_back({"direction",
                  Cells{of.last_direction, 3, 1, {}},
                  "",
                  "",
                  {"in shortening", "before the first motion", "in lengthening"}});
  axes.push_back({"rate", by_quantile(of.rate_mm_s, 24), " mm/s", ""});
  axes.push_back({"time", by_quantile(of.time_s, 24), " s", several_recordings ? " of all recordings in a row" : ""});
  axes.push_back({"history", by_quantile(of.travel_mm, 24), " mm", " of travel"});
  if (std::ranges::any_of(of.pressure_psi, [](double p) { return p != 0.0; }))
    axes.push_back({"pressure", by_quantile(of.pressure_psi, 20), " psi", " off its nominal value"});
  // Time since the corner: of the motion last made (what relaxes), and of how the velocity changed there
  // (what has mass, or a lag).
  axes.push_back({"hold",
                  with_group(by_quantile(of.since_s, 10), of.last_direction),
                  " s",
                  " after a corner",
                  {" of shortening", " before the first motion", " of lengthening"}});
  const double longest_s = std::max(3.0, *std::ranges::max_element(of.since_s));
  axes.push_back(
      {"onset",
       with_group(by_edges(of.since_s, {0.0, 0.02, 0.05, 0.1, 0.3, 2.0, longest_s}), turns(of.direction, of.since_s)),
       " s",
       " after a corner",
       {" towards shortening", " that turns nothing", " towards lengthening"}});
  return axes;
}

Cells without_groups(Cells cells) {
  for (int& cell : cells.cell) cell %= cells.per_group;
  cells.count = cells.per_group;
  return cells;
}

}  // namespace isorig::identify
