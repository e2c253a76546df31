#include "identify/diagnose/search/events.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <tuple>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/basis.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {

using model::ModelSpec;

std::vector<EventPlace> event_places(const Problem& problem, const ModelSpec& spec, const NoiseModel& noise,
                                     double force_step, std::size_t count) {
  RowMatrix a;
  problem.columns(spec, a);
  a.conservativeResize(Eigen::NoChange, a.cols() + 1);
  a.col(a.cols() - 1) = problem.target();
  NoiseModel white = noise;
  white.coloured_N = 0.0;
  whiten(problem.series(), white, a);
  const Eigen::Index m = a.cols() - 1;
  const Eigen::MatrixXd q = orthonormal_basis(a.leftCols(m));
  Eigen::VectorXd r = a.col(m);
  r -= q * (q.transpose() * r);
  std::vector<std::pair<double, EventPlace>> gains;
  Eigen::Index first_row = 0;
  for (std::size_t i = 0; i < problem.series().size(); ++i) {
    const Series& series = problem.series()[i];
    Eigen::VectorXd qs = Eigen::VectorXd::Zero(q.cols());
    double rs = 0.0, ss = 0.0;
    for (std::size_t k = series.nodes.size(); k-- > 1;) {
      const auto row = first_row + static_cast<Eigen::Index>(k);
      const double w = std::sqrt(series.count[k]) / white.white_N;
      rs += w * r[row];
      ss += w * w;
      qs += w * q.row(row).transpose();
      const double rest = ss - qs.squaredNorm();
      if (rest > 1e-6 * ss && rs * force_step > 0.0)
        gains.emplace_back(rs * rs / rest, EventPlace{i, 0.5 * (series.nodes[k].t_s + series.nodes[k - 1].t_s)});
    }
    first_row += static_cast<Eigen::Index>(series.nodes.size());
  }
  std::ranges::sort(gains, {}, [](const std::pair<double, EventPlace>& one) {
    return std::make_tuple(-one.first, one.second.series, one.second.time_s);
  });
  std::vector<EventPlace> places;
  for (const auto& [gain, place] : gains) {
    if (places.size() >= count) break;
    const bool apart = std::ranges::all_of(places, [&, at = place](const EventPlace& other) {
      return other.series != at.series || std::fabs(other.time_s - at.time_s) > deciding().events_apart_s;
    });
    if (apart) places.push_back(place);
  }
  return places;
}

Fit refine_event(const Problem& problem, const Fit& from) {
  // A candidate time is refitted only where the coefficients alone bring its score within kHopeless of the best, and
  // taken only for a gain of kWorth. Without these thresholds the scan would follow an event that hardly changes the
  // fit through the whole recording. What it does follow far it follows in steps that grow: a gradual law beside
  // physics that is missing took 1,600 steps of 4 s.
  constexpr double kHopeless = 10.0, kWorth = 0.05;
  constexpr int kFar = 3;  // steps in a row
  const std::size_t time = model::event_parameter(*from.spec.parts.back().law);
  const auto& nodes = problem.series()[series_of(from.spec.parts.back(), problem.series())].nodes;
  Fit best = from;
  const auto try_step = [&](double step_s) {
    ModelSpec spec = best.spec;
    double& time_s = spec.parts.back().parameters[time];
    time_s += step_s;
    if (time_s <= nodes.front().t_s || time_s > nodes.back().t_s) return false;
    ModelSpec moved_alone = spec;
    Eigen::VectorXd ignored;
    if (problem.solve(moved_alone, ignored) > best.chi2 + kHopeless) return false;
    Fit fit = problem.fit(spec, 3);
    if (fit.chi2 >= best.chi2 * (1.0 - 1e-6) - kWorth) return false;
    best = std::move(fit);
    return true;
  };
  double step_s = 4.0, last = 0.0;
  for (int in_a_row = 0; step_s > 0.004;) {
    const double sign = try_step(step_s) ? 1.0 : try_step(-step_s) ? -1.0 : 0.0;
    in_a_row = sign == 0.0 ? 0 : sign == last ? in_a_row + 1 : 1;
    last = sign;
    if (sign == 0.0) step_s *= 0.4;
    if (in_a_row >= kFar) step_s *= 2.0;
  }
  return problem.fit(best.spec, 15);
}

namespace {

/// Squares that one more event has to take off (with_further_events), in units of what `fit` leaves. What a law of it
/// has beyond its time and its size costs as any number of a model does.
double price_of_event(const Fit& fit, const model::Law& law) {
  constexpr double kTimeAndSize = 2.0;
  const auto numbers = static_cast<double>(
      std::ranges::count_if(law.parameters, [](const model::Parameter& parameter) { return !parameter.fixed; }));
  const double rows = static_cast<double>(fit.rows);
  return (deciding().event_price_log_rows + 2.0 * deciding().numbers_cost_log_rows * (numbers - kTimeAndSize)) *
         std::log(rows) * std::max(1.0, fit.chi2 / rows);
}

}  // namespace

Fit with_further_events(const Problem& problem, const Fit& from,
                        const std::function<bool(const ModelSpec&)>& may_stay) {
  constexpr std::size_t kTimes = 2;
  Fit best = from;
  const model::Physics& effect = *from.spec.parts.back().physics;
  const double force_step = from.spec.parts.back().law->traits.event_force_step;
  for (std::size_t count = 1; count < deciding().most_events; ++count) {
    std::vector<std::pair<double, Fit>> candidates;
    for (const EventPlace& place : event_places(problem, best.spec, problem.noise(), force_step, kTimes)) {
      for (const model::Law& known : effect.laws) {
        if (!model::is_event(known)) continue;
        const model::Law& law = model::law_at(known, best.spec.length_scale);
        ModelSpec spec = best.spec;
        spec.parts.push_back(model::make_part(effect, law));
        model::fill_from_recording(spec.parts.back(), problem.series()[place.series].excitation.reference);
        spec.parts.back().parameters[model::event_parameter(law)] = place.time_s;
        Fit fit = problem.fit(spec, 6);
        if (may_stay(fit.spec)) candidates.emplace_back(fit.chi2 + price_of_event(fit, law), std::move(fit));
      }
    }
    std::ranges::stable_sort(candidates, {}, &std::pair<double, Fit>::first);
    std::optional<Fit> more;
    for (const auto& [cost, fit] : candidates) {
      Fit refined = refine_event(problem, fit);
      if (!may_stay(refined.spec)) continue;
      if (best.chi2 - refined.chi2 >= price_of_event(refined, *refined.spec.parts.back().law))
        more = std::move(refined);
      break;
    }
    if (!more) break;
    best = std::move(*more);
  }
  return without_idle_events(problem, best);
}

Fit without_idle_events(const Problem& problem, const Fit& from) {
  Fit best = from;
  Eigen::VectorXd ignored;
  for (;;) {
    // The event that is missed least with the other numbers as they are; then all of them are fitted without it.
    std::optional<ModelSpec> least;
    const model::Law* law = nullptr;
    double least_cost = 0.0;
    const auto& parts = best.spec.parts;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (!model::is_event(*parts[i].law) || std::ranges::count(parts, parts[i].physics, &model::Part::physics) < 2)
        continue;
      ModelSpec rest = best.spec;
      rest.parts.erase(rest.parts.begin() + static_cast<std::ptrdiff_t>(i));
      const double cost = problem.solve(rest, ignored) - price_of_event(best, *parts[i].law);
      if (least && cost >= least_cost) continue;
      least_cost = cost;
      law = parts[i].law;
      least = std::move(rest);
    }
    if (!least) return best;
    Fit without = problem.fit(*least, 8);
    if (without.chi2 - best.chi2 >= price_of_event(best, *law)) return best;
    best = std::move(without);
  }
}

bool explained_without(const Fit& event, const Fit& other, double leaves_ratio) noexcept {
  const auto rows = static_cast<double>(other.rows);
  return other.chi2 < rows + deciding().chance_deviations * std::sqrt(2.0 * rows) &&
         event.chi2 > leaves_ratio * other.chi2;
}

RowErrors row_errors(const ModelSpec& spec, const Series& series, const std::vector<bool>& usable) {
  RowErrors out;
  model::RunningModel running(spec, series.excitation.reference);
  running.reset(series.excitation.instants.front());
  std::optional<model::RunningModel> nominal;
  if (spec.seen && spec.seen->share < 1.0) nominal.emplace(fades_to(spec), series.excitation.reference);
  if (nominal) nominal->reset(series.excitation.instants.front());
  for (std::size_t k = 0; k < series.excitation.instants.size(); ++k) {
    double force_N = running.step(series.excitation.instants[k]);
    if (nominal) force_N = predicted_N(*spec.seen, nominal->step(series.excitation.instants[k]), force_N);
    const double e = series.recording.frame.force_N[k] - force_N;
    if (!usable.empty() && !usable[k]) continue;
    out.squares_N2 += e * e;
    ++out.rows;
  }
  return out;
}

namespace {

/// Least value of n, and where. A row on the wrong side of an event errs by the event's whole force, so the squares
/// rise on both sides of it by the force squared for each row: a valley, whose floor is as rough as the noise of some
/// rows. Every n^(2/3)-th place is looked at, then every n^(1/3)-th beside the least of them, then every one: 65 of
/// 2,000. Of 28 slips of six recordings 27 got the row that a scan of all rows finds; the other, known to 0.85 s, got
/// another row of its interval.
std::pair<double, std::size_t> least_of_valley(std::size_t n, const std::function<double(std::size_t)>& value) {
  std::pair<double, std::size_t> best{std::numeric_limits<double>::infinity(), 0};
  std::size_t from = 0, to = n;
  for (const double power : {2.0 / 3.0, 1.0 / 3.0, 0.0}) {
    const auto stride = static_cast<std::size_t>(std::max(std::pow(static_cast<double>(n), power), 1.0));
    for (std::size_t k = from; k < to; k += stride) best = std::min(best, {value(k), k});
    from = best.second - std::min(best.second, stride);
    to = std::min(best.second + stride + 1, n);
  }
  return best;
}

}  // namespace

void place_events(ModelSpec& spec, std::span<const Series> all, const std::vector<std::vector<bool>>& usable_rows) {
  for (auto& part : spec.parts) {
    const std::size_t time = model::event_parameter(*part.law);
    if (time == part.parameters.size()) continue;
    const std::size_t own = series_of(part, all);
    const Series& series = all[own];
    const std::vector<bool>& usable = usable_rows[own];
    double& at_s = part.parameters[time];
    double before = series.nodes.front().t_s, after = series.nodes.back().t_s;
    for (const auto& node : series.nodes) {
      if (node.t_s < at_s)
        before = node.t_s;
      else {
        after = node.t_s;
        break;
      }
    }
    std::vector<double> times_s;
    for (const auto& row : series.excitation.instants)
      if (row.t_s >= before - 1.0 && row.t_s <= after + 1.0) times_s.push_back(row.t_s - 0.5 * row.dt_s);
    const double given_s = at_s, given = row_errors(spec, series, usable).squares_N2;
    const auto squares = [&](std::size_t k) {
      at_s = times_s[k];
      return row_errors(spec, series, usable).squares_N2;
    };
    const auto [best, k] = least_of_valley(times_s.size(), squares);
    at_s = best < given ? times_s[k] : given_s;
  }
}

}  // namespace isorig::identify
