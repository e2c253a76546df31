#include "identify/diagnose/locate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>

namespace isorig::identify {
namespace {

/// Share of the excess that a table of the covariate (means per cell) would take away, with every cell's own
/// cost in degrees of freedom paid. Weighted by readings.
struct Cells {
  std::vector<int> cell;  // -1: not seen
  int count = 0;
};

double share_of(const Cells& cells, const Eigen::VectorXd& residual, const std::vector<double>& block_weight,
                const std::vector<int>& block, double noise) {
  std::vector<double> sum(static_cast<std::size_t>(cells.count), 0.0), n(sum.size(), 0.0);
  double total = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double w = block_weight[block[i]];
    if (w == 0.0 || cells.cell[i] < 0) continue;
    sum[cells.cell[i]] += w * residual[i];
    n[cells.cell[i]] += w;
    total += w * (residual[i] * residual[i] - noise);
  }
  double explained = 0.0;
  for (std::size_t c = 0; c < sum.size(); ++c)
    if (n[c] > 0.0) explained += std::max(sum[c] * sum[c] / n[c] - noise, 0.0);
  return total > 0.0 ? std::clamp(explained / total, 0.0, 1.0) : 0.0;
}

Cells by_quantile(const std::vector<double>& value, int count) {
  std::vector<double> sorted = value;
  std::ranges::sort(sorted);
  std::vector<double> edges;
  for (int c = 1; c < count; ++c)
    edges.push_back(sorted[sorted.size() * static_cast<std::size_t>(c) / count]);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Cells cells{{}, static_cast<int>(edges.size()) + 1};
  for (const double v : value)
    cells.cell.push_back(static_cast<int>(std::upper_bound(edges.begin(), edges.end(), v) - edges.begin()));
  return cells;
}

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0f %%", 100.0 * share);
  return text;
}

}  // namespace

std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal, double noise_scale) {
  model::ModelSpec spec = nominal;
  Eigen::VectorXd residual;
  (void)problem.solve(spec, residual);
  const auto series = problem.series();
  std::vector<double> time, position, rate, since, travel, pressure, hold;
  std::vector<int> direction, block;
  double start = 0.0;
  int blocks = 0;
  for (const Series& each : series) {
    double travelled = 0.0;
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      const auto& node = each.nodes[k];
      travelled += std::fabs(node.step_mm);
      time.push_back(start + node.t_s);
      position.push_back(node.position_mm);
      rate.push_back(node.velocity_mm_s);
      since.push_back(each.since_corner_s[k]);
      travel.push_back(travelled);
      pressure.push_back(node.excess_pressure_psi);
      // A block ends where a rest ends: what follows is another look at the same physics.
      if (k == 0 || (each.since_corner_s[k] == 0.0 && each.since_corner_s[k - 1] > 5.0)) ++blocks;
      block.push_back(blocks - 1);
    }
    start += each.nodes.back().t_s + 1.0;
  }
  const std::size_t n = time.size();
  double fastest = 1e-9;
  for (const double v : rate) fastest = std::max(fastest, std::fabs(v));
  for (std::size_t i = 0; i < n; ++i)
    direction.push_back(rate[i] > 3e-4 * fastest ? 2 : rate[i] < -3e-4 * fastest ? 0 : 1);
  // Direction keeps its memory in a hold: friction does.
  std::vector<int> last_direction = direction;
  for (std::size_t i = 1; i < n; ++i)
    if (direction[i] == 1) last_direction[i] = last_direction[i - 1];

  std::vector<std::pair<std::string, Cells>> axes;
  axes.emplace_back("position", by_quantile(position, 60));
  axes.emplace_back("strain", by_quantile(position, 10));
  axes.emplace_back("direction", Cells{last_direction, 3});
  axes.emplace_back("rate", by_quantile(rate, 24));
  axes.emplace_back("time", by_quantile(time, 24));
  axes.emplace_back("history", by_quantile(travel, 24));
  if (std::ranges::any_of(pressure, [](double p) { return p != 0.0; }))
    axes.emplace_back("pressure", by_quantile(pressure, 20));
  // Onset and hold: time since the corner, apart by direction of the last motion.
  const auto with_direction = [&](Cells cells) {
    for (std::size_t i = 0; i < n; ++i) cells.cell[i] += cells.count * last_direction[i];
    cells.count *= 3;
    return cells;
  };
  std::vector<double> capped = since;
  axes.emplace_back("hold", with_direction(by_quantile(capped, 10)));
  Cells onset{{}, 4};
  for (std::size_t i = 0; i < n; ++i)
    onset.cell.push_back(since[i] < 0.05 ? 0 : since[i] < 0.3 ? 1 : since[i] < 2.0 ? 2 : 3);
  axes.emplace_back("onset", with_direction(onset));

  const std::vector<double> once(static_cast<std::size_t>(blocks), 1.0);
  double total = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) total += residual[i] * residual[i] - noise_scale;
  std::vector<Place> places;
  if (total <= 0.0) return places;
  const auto& frame = series[0].recording.frame;
  for (const auto& [name, cells] : axes) {
    Place place;
    place.covariate = name;
    place.t_start_s = frame.t_s.front();
    place.t_end_s = frame.t_s.back();
    place.share = share_of(cells, residual, once, block, noise_scale);
    std::mt19937 random(7);
    std::vector<double> shares;
    for (int draw = 0; draw < 40; ++draw) {
      std::vector<double> weight(static_cast<std::size_t>(blocks), 0.0);
      for (int b = 0; b < blocks; ++b) weight[random() % static_cast<unsigned>(blocks)] += 1.0;
      shares.push_back(share_of(cells, residual, weight, block, noise_scale));
    }
    std::ranges::sort(shares);
    place.share_low = shares[1];
    place.share_high = shares[shares.size() - 2];
    // Where along the axis: the cells that carry most.
    place.text = "a function of " + name + " alone would take " + percent(place.share) + " of the excess (" +
                 percent(place.share_low) + " to " + percent(place.share_high) + ")";
    places.push_back(std::move(place));
  }
  std::ranges::stable_sort(places, std::greater<>(), &Place::share);
  std::erase_if(places, [](const Place& p) { return p.share < 0.03; });

  // Times: the stretches of the record that hold the excess, at most five.
  constexpr std::size_t kWindows = 200;
  std::vector<double> power(kWindows, 0.0);
  const double first = time.front(), span = std::max(time.back() - first, 1e-9);
  for (std::size_t i = 0; i < n; ++i) {
    const auto w =
        std::min<std::size_t>(kWindows - 1, static_cast<std::size_t>((time[i] - first) / span * kWindows));
    const auto row = static_cast<Eigen::Index>(i);
    power[w] += residual[row] * residual[row] - noise_scale;
  }
  std::vector<Place> times;
  const double mean = total / kWindows;
  for (std::size_t w = 0; w < kWindows;) {
    if (power[w] < 3.0 * mean) {
      ++w;
      continue;
    }
    const std::size_t from = w;
    double sum = 0.0;
    while (w < kWindows && power[w] >= 3.0 * mean) sum += power[w++];
    Place place;
    place.covariate = "time";
    place.t_start_s = first + span * static_cast<double>(from) / kWindows;
    place.t_end_s = first + span * static_cast<double>(w) / kWindows;
    place.share = place.share_low = place.share_high = std::clamp(sum / total, 0.0, 1.0);
    place.text = percent(place.share) + " of the excess stands in this stretch";
    times.push_back(std::move(place));
  }
  std::ranges::stable_sort(times, std::greater<>(), &Place::share);
  if (times.size() > 5) times.resize(5);
  places.insert(places.end(), times.begin(), times.end());
  return places;
}

}  // namespace isorig::identify
