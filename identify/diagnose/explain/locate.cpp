#include "identify/diagnose/explain/locate.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "identify/diagnose/explain/axes.hpp"

namespace isorig::identify {
namespace {

/// Share of the excess that a table of the variable (means per cell) would explain, less the degrees of freedom of its
/// cells. In the whitened residual a force f appears as f times the root of the readings in its bin; the table is one
/// of the force.
double share_of(const Cells& cells, const Eigen::VectorXd& residual, const std::vector<double>& count,
                const std::vector<double>& move_weight, const std::vector<std::size_t>& move, double noise) {
  std::vector<double> sum(static_cast<std::size_t>(cells.count), 0.0), n(sum.size(), 0.0);
  double total = 0.0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double w = move_weight[move[static_cast<std::size_t>(i)]];
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

std::string percent(double share) {
  return base::formatted("%.0f %%", 100.0 * share);
}

std::string number(double value) {
  return base::number_text(value, 3);
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
  // Averaging into bins has taken white noise out: it is added back (fit/left_out.hpp).
  const double averaged = white_N * white_N * std::max(1.0 - bins / readings, 0.0);
  place.nominal_rmse_N = std::sqrt(nominal / readings + averaged);
  place.model_rmse_N = std::sqrt(model / readings + averaged);
}

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

/// The excess of the nominal model and what locates it.
struct Excess {
  const Covariates& covariates;
  const Eigen::VectorXd& residual;
  const std::vector<Error>& errors;
  double white_N;
  double noise;  ///< whitened square that one bin has by noise alone
};

/// Share of the excess that a table of this axis would take, and its 95 % by a bootstrap that draws whole moves: the
/// bins of one move err alike (Efron & Tibshirani 1993, 8.5).
void set_share(Place& place, const Cells& cells, const Excess& excess) {
  constexpr int kDraws = 40;  // the second of each end: 95 %
  const std::size_t moves = excess.covariates.moves.count;
  const auto share = [&](const std::vector<double>& weight) {
    return share_of(cells, excess.residual, excess.covariates.readings, weight, excess.covariates.moves.of_bin,
                    excess.noise);
  };
  place.share = share(std::vector<double>(moves, 1.0));
  std::mt19937 random(7);
  std::vector<double> shares;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<double> weight(moves, 0.0);
    for (std::size_t m = 0; m < moves; ++m) weight[random() % static_cast<unsigned>(moves)] += 1.0;
    shares.push_back(share(weight));
  }
  std::ranges::sort(shares);
  place.share_low = shares[1];
  place.share_high = shares[shares.size() - 2];
}

Place place_on(const Axis& axis, const Excess& excess, double begin_s, double end_s) {
  Place place;
  place.covariate = axis.name;
  place.t_start_s = begin_s;
  place.t_end_s = end_s;
  set_share(place, axis.cells, excess);
  Axis shown = axis;
  Concentration half = concentration_of(shown.cells, excess.residual, excess.covariates.readings, excess.noise);
  if (half.first < 0) {  // in no group alone
    shown.cells = without_groups(shown.cells);
    half = concentration_of(shown.cells, excess.residual, excess.covariates.readings, excess.noise);
  }
  place.text = "a function of " + axis.name + " alone would take " + percent(place.share) + " of the excess (" +
               percent(place.share_low) + " to " + percent(place.share_high) + ")" + text_of(shown, half);
  measure(place, excess.errors, excess.white_N, [&](std::size_t i) {
    return half.first < 0 || (shown.cells.cell[i] >= half.first && shown.cells.cell[i] <= half.last);
  });
  return place;
}

}  // namespace

std::vector<Place> locate(const Problem& problem, const model::ModelSpec& nominal, const model::ModelSpec& model,
                          double noise_scale) {
  model::ModelSpec spec = nominal;
  Eigen::VectorXd residual;
  (void)problem.solve(spec, residual);
  const double total = residual.squaredNorm() - noise_scale * static_cast<double>(residual.size());
  if (total <= 0.0) return {};

  const auto series = problem.series();
  const Covariates covariates = covariates_of(series);
  const Eigen::VectorXd nominal_N = problem.target() - problem.predict(nominal);
  Eigen::VectorXd model_N = problem.target() - problem.predict(model);
  if (model.seen)
    for (Eigen::Index i = 0; i < model_N.size(); ++i)
      model_N[i] = predicted_N(*model.seen, nominal_N[i], model_N[i]);  // errors add up as the forces do
  std::vector<Error> errors;
  for (Eigen::Index i = 0; i < residual.size(); ++i)
    errors.push_back({nominal_N[i], model_N[i], covariates.readings[static_cast<std::size_t>(i)]});
  double begin_s = 1e300, end_s = -1e300;
  for (const Series& each : series) {
    begin_s = std::min(begin_s, each.recording.frame.t_s.front());
    end_s = std::max(end_s, each.recording.frame.t_s.back());
  }
  const double white_N = problem.noise().white_N;
  const Excess excess{covariates, residual, errors, white_N, noise_scale};
  std::vector<Place> places;
  for (const Axis& axis : axes_of(covariates, series.size() > 1))
    places.push_back(place_on(axis, excess, begin_s, end_s));
  std::ranges::stable_sort(places, std::greater<>(), &Place::share);
  std::erase_if(places, [](const Place& p) { return p.share < 0.03; });

  const std::vector<Place> times = stretches(series, residual, errors, white_N, noise_scale, total);
  places.insert(places.end(), times.begin(), times.end());
  return places;
}

}  // namespace isorig::identify
