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

}  // namespace

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
