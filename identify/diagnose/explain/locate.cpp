#include "identify/diagnose/explain/locate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>

namespace isorig::identify {
namespace {

/// Cells of a variable, in groups of `per_group` neighbours: one group, or one for each direction of the last
/// motion.
struct Cells {
  std::vector<int> cell;  // -1: not seen
  int count = 0;
  int per_group = 0;
  std::vector<double> edges;  // of a group's cells, both ends included; empty: the groups say all
};

/// Share of the excess that a table of the variable (means per cell) would take away, with every cell's own
/// cost in degrees of freedom paid. The residual is whitened, so that a force of f stands there as f times
/// the root of the readings in its bin: the table is of the force.
double share_of(const Cells& cells, const Eigen::VectorXd& residual, const std::vector<double>& count,
                const std::vector<double>& block_weight, const std::vector<int>& block, double noise) {
  std::vector<double> sum(static_cast<std::size_t>(cells.count), 0.0), n(sum.size(), 0.0);
  double total = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double w = block_weight[block[i]];
    if (w == 0.0 || cells.cell[i] < 0) continue;
    const double readings = count[static_cast<std::size_t>(i)];
    sum[cells.cell[i]] += w * std::sqrt(readings) * residual[i];
    n[cells.cell[i]] += w * readings;
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

Cells without_groups(Cells cells) {
  for (int& cell : cells.cell) cell %= cells.per_group;
  cells.count = cells.per_group;
  return cells;
}

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0f %%", 100.0 * share);
  return text;
}

std::string number(double value) {
  char text[24];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// "7.9 to 8.1 mm/s": the fewest readings of neighbouring cells that hold half of the excess.
struct Concentration {
  int first = 0, last = 0;
  double readings = 1.0;  ///< share of all
};

Concentration concentration_of(const Cells& cells, const Eigen::VectorXd& residual, const std::vector<double>& count,
                               double noise) {
  std::vector<double> power(static_cast<std::size_t>(cells.count), 0.0), n(power.size(), 0.0);
  double all = 0.0, all_n = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    if (cells.cell[row] < 0) continue;
    const auto c = static_cast<std::size_t>(cells.cell[row]);
    power[c] += residual[i] * residual[i] - noise;
    n[c] += count[row];
    all += residual[i] * residual[i] - noise;
    all_n += count[row];
  }
  Concentration best{-1, -1, 2.0};
  for (int from = 0; from < cells.count; ++from) {
    double sum = 0.0, readings = 0.0;
    for (int to = from; to < cells.count && to / cells.per_group == from / cells.per_group; ++to) {
      sum += power[static_cast<std::size_t>(to)];
      readings += n[static_cast<std::size_t>(to)];
      if (sum < 0.5 * all) continue;
      if (readings / all_n < best.readings) best = {from, to, readings / all_n};
      break;
    }
  }
  return best;
}

/// Measured minus simulated of a bin, and the readings it stands for.
struct Error {
  double nominal_N, model_N, readings;
};

/// Errors of both models over what `inside` says.
template <typename Inside>
void measure(Place& place, const std::vector<Error>& errors, double white_N, Inside inside) {
  double nominal = 0.0, model = 0.0, readings = 0.0, bins = 0.0;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    if (!inside(i)) continue;
    nominal += errors[i].readings * errors[i].nominal_N * errors[i].nominal_N;
    model += errors[i].readings * errors[i].model_N * errors[i].model_N;
    readings += errors[i].readings;
    bins += 1.0;
  }
  if (readings == 0.0) return;
  // What averaging into bins took of the white noise.
  const double averaged = white_N * white_N * std::max(1.0 - bins / readings, 0.0);
  place.nominal_rmse_N = std::sqrt(nominal / readings + averaged);
  place.model_rmse_N = std::sqrt(model / readings + averaged);
}

struct Axis {
  std::string name;
  Cells cells;
  const char* unit = "";  ///< of the edges
  const char* after = "";
  std::array<const char*, 3> groups{};
};

std::string text_of(const Axis& axis, const Concentration& where) {
  if (where.first < 0) return {};
  const Cells& cells = axis.cells;
  std::string text = "; half of it stands ";
  if (!cells.edges.empty()) {
    const int from = where.first % cells.per_group, to = where.last % cells.per_group;
    double low = cells.edges[static_cast<std::size_t>(from)], high = cells.edges[static_cast<std::size_t>(to) + 1];
    const double grain = 1e-3 * std::max(std::fabs(low), std::fabs(high));
    if (std::fabs(low) < grain) low = 0.0;
    if (std::fabs(high) < grain) high = 0.0;
    text += "at " + number(low);
    if (number(high) != number(low)) text += " to " + number(high);
    text += axis.unit;
    text += axis.after;
  }
  if (cells.count > cells.per_group) {
    text += axis.groups[static_cast<std::size_t>(where.first / cells.per_group)];
  }
  return text + " (" + percent(where.readings) + " of the readings)";
}

/// The stretches of the recordings that hold the excess, at most five.
std::vector<Place> stretches(std::span<const Series> series, const Eigen::VectorXd& residual,
                             const std::vector<Error>& errors, double white_N, double noise, double total) {
  constexpr double kWindows = 200.0;
  double all_s = 0.0;
  for (const Series& each : series) all_s += each.nodes.back().t_s - each.nodes.front().t_s;
  all_s = std::max(all_s, 1e-9);
  std::vector<Place> out;
  Eigen::Index row = 0;
  for (const Series& each : series) {
    const auto begin = static_cast<std::size_t>(row);
    const double first = each.nodes.front().t_s, span = std::max(each.nodes.back().t_s - first, 1e-9);
    const auto windows = static_cast<std::size_t>(std::max(10.0, std::round(kWindows * span / all_s)));
    std::vector<double> power(windows, 0.0), variance(windows, 0.0);
    for (const auto& node : each.nodes) {
      const auto w =
          std::min(windows - 1, static_cast<std::size_t>((node.t_s - first) / span * static_cast<double>(windows)));
      const double square = residual[row] * residual[row];
      power[w] += square - noise;
      // r = s + e: var(r^2) = 4 s^2 noise + 2 noise^2.
      variance[w] += 4.0 * std::max(square - noise, 0.0) * noise + 2.0 * noise * noise;
      ++row;
    }
    const double mean = total / kWindows;
    for (std::size_t w = 0; w < windows;) {
      if (power[w] < 3.0 * mean) {
        ++w;
        continue;
      }
      const std::size_t from = w;
      double sum = 0.0, sum_variance = 0.0;
      for (; w < windows && power[w] >= 3.0 * mean; ++w) {
        sum += power[w];
        sum_variance += variance[w];
      }
      Place place;
      place.covariate = "time";
      place.t_start_s = first + span * static_cast<double>(from) / static_cast<double>(windows);
      place.t_end_s = first + span * static_cast<double>(w) / static_cast<double>(windows);
      const double half = 1.96 * std::sqrt(sum_variance) / total;
      place.share = std::clamp(sum / total, 0.0, 1.0);
      place.share_low = std::clamp(place.share - half, 0.0, 1.0);
      place.share_high = std::clamp(place.share + half, 0.0, 1.0);
      place.text = "this stretch" + (series.size() > 1 ? " of " + each.name : std::string()) + " holds " +
                   percent(place.share) + " of the excess";
      place.recording = each.name;
      measure(place, errors, white_N, [&](std::size_t i) {
        if (i < begin || i >= begin + each.nodes.size()) return false;
        const double t = each.nodes[i - begin].t_s;
        return t >= place.t_start_s && t <= place.t_end_s;
      });
      out.push_back(std::move(place));
    }
  }
  std::ranges::stable_sort(out, std::greater<>(), &Place::share);
  if (out.size() > 5) out.resize(5);
  return out;
}

}  // namespace

std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal, const model::ModelSpec& model,
                          double noise_scale) {
  model::ModelSpec spec = nominal;
  Eigen::VectorXd residual;
  (void)problem.solve(spec, residual);
  const auto series = problem.series();
  std::vector<double> time, position, rate, since, travel, pressure, count;
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
      count.push_back(each.count[k]);
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
  // Direction keeps its memory in a hold: friction does. A ramp's end overshoots by some noises of the
  // reading, and the velocity trembles by more than a slow return: what counts as a turn is a thousandth of
  // the whole stroke.
  const auto [lowest_mm, highest_mm] = std::ranges::minmax(position);
  std::vector<int> last_direction;
  for (const Series& each : series) {
    const double turn_mm = std::max(1e-3 * (highest_mm - lowest_mm), 10.0 * each.excitation.motion.noise_mm);
    double follower_mm = each.nodes.front().position_mm;
    int last = 1;
    for (const auto& node : each.nodes) {
      const double before_mm = follower_mm;
      follower_mm = std::clamp(follower_mm, node.position_mm - 0.5 * turn_mm, node.position_mm + 0.5 * turn_mm);
      if (follower_mm != before_mm) last = follower_mm > before_mm ? 2 : 0;
      last_direction.push_back(last);
    }
  }

  const Eigen::VectorXd nominal_N = problem.target() - problem.predict(nominal);
  const Eigen::VectorXd model_N = problem.target() - problem.predict(model);
  std::vector<Error> errors;
  for (std::size_t i = 0; i < n; ++i)
    errors.push_back({nominal_N[static_cast<Eigen::Index>(i)], model_N[static_cast<Eigen::Index>(i)], count[i]});
  std::vector<double> strain;
  for (const double x : position) strain.push_back(100.0 * series[0].recording.strain(x));
  std::vector<Axis> axes;
  axes.push_back({"position", by_quantile(position, 60), " mm", ""});
  axes.push_back({"strain", by_quantile(strain, 10), " %", ""});
  axes.push_back({"direction",
                  Cells{last_direction, 3, 1, {}},
                  "",
                  "",
                  {"in shortening", "before the first motion", "in lengthening"}});
  axes.push_back({"rate", by_quantile(rate, 24), " mm/s", ""});
  axes.push_back({"time", by_quantile(time, 24), " s", series.size() > 1 ? " of all recordings in a row" : ""});
  axes.push_back({"history", by_quantile(travel, 24), " mm", " of travel"});
  if (std::ranges::any_of(pressure, [](double p) { return p != 0.0; }))
    axes.push_back({"pressure", by_quantile(pressure, 20), " psi", " off its nominal value"});
  // Time since the corner: of the motion last made (what relaxes), and of how the velocity changed there
  // (what has mass, or a lag).
  axes.push_back({"hold",
                  with_group(by_quantile(since, 10), last_direction),
                  " s",
                  " after a corner",
                  {" of shortening", " before the first motion", " of lengthening"}});
  const double longest_s = std::max(3.0, *std::ranges::max_element(since));
  axes.push_back({"onset",
                  with_group(by_edges(since, {0.0, 0.02, 0.05, 0.1, 0.3, 2.0, longest_s}), turns(direction, since)),
                  " s",
                  " after a corner",
                  {" towards shortening", " that turns nothing", " towards lengthening"}});

  const std::vector<double> once(static_cast<std::size_t>(blocks), 1.0);
  double total = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) total += residual[i] * residual[i] - noise_scale;
  std::vector<Place> places;
  if (total <= 0.0) return places;
  double begin_s = 1e300, end_s = -1e300;
  for (const Series& each : series) {
    begin_s = std::min(begin_s, each.recording.frame.t_s.front());
    end_s = std::max(end_s, each.recording.frame.t_s.back());
  }
  for (const Axis& axis : axes) {
    const Cells& cells = axis.cells;
    Place place;
    place.covariate = axis.name;
    place.t_start_s = begin_s;
    place.t_end_s = end_s;
    place.share = share_of(cells, residual, count, once, block, noise_scale);
    std::mt19937 random(7);
    std::vector<double> shares;
    for (int draw = 0; draw < 40; ++draw) {
      std::vector<double> weight(static_cast<std::size_t>(blocks), 0.0);
      for (int b = 0; b < blocks; ++b) weight[random() % static_cast<unsigned>(blocks)] += 1.0;
      shares.push_back(share_of(cells, residual, count, weight, block, noise_scale));
    }
    std::ranges::sort(shares);
    place.share_low = shares[1];
    place.share_high = shares[shares.size() - 2];
    Axis shown = axis;
    Concentration half = concentration_of(shown.cells, residual, count, noise_scale);
    if (half.first < 0) {  // in no group alone
      shown.cells = without_groups(shown.cells);
      half = concentration_of(shown.cells, residual, count, noise_scale);
    }
    place.text = "a function of " + axis.name + " alone would take " + percent(place.share) + " of the excess (" +
                 percent(place.share_low) + " to " + percent(place.share_high) + ")" + text_of(shown, half);
    measure(place, errors, problem.noise().white_N, [&](std::size_t i) {
      return half.first < 0 || (shown.cells.cell[i] >= half.first && shown.cells.cell[i] <= half.last);
    });
    places.push_back(std::move(place));
  }
  std::ranges::stable_sort(places, std::greater<>(), &Place::share);
  std::erase_if(places, [](const Place& p) { return p.share < 0.03; });

  const std::vector<Place> times = stretches(series, residual, errors, problem.noise().white_N, noise_scale, total);
  places.insert(places.end(), times.begin(), times.end());
  return places;
}

}  // namespace isorig::identify
