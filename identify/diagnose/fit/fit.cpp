#include "identify/diagnose/fit/fit.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/fit/evaluator.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/noise_search.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;

/// Of free parameters, in the coordinates that they are searched in.
Eigen::VectorXd coordinates(const ModelSpec& spec, const std::vector<FreeNumber>& numbers) {
  Eigen::VectorXd u(static_cast<Eigen::Index>(numbers.size()));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    u[static_cast<Eigen::Index>(i)] = to_search(parameter_of(spec, numbers[i]), value_of(spec, numbers[i]));
  return u;
}

void set_coordinates(ModelSpec& spec, const std::vector<FreeNumber>& numbers, const Eigen::VectorXd& u) {
  for (std::size_t i = 0; i < numbers.size(); ++i)
    value_of(spec, numbers[i]) = from_search(parameter_of(spec, numbers[i]), u[static_cast<Eigen::Index>(i)]);
}

}  // namespace

Problem::Problem(std::span<const Series> series, NoiseModel noise) : series_(series) {
  std::size_t total = 0;
  for (const Series& each : series) total += each.nodes.size();
  force_.resize(static_cast<Eigen::Index>(total));
  Eigen::Index row = 0;
  for (const Series& each : series) {
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      force_[row++] = each.force_N[k];
      if (each.count[k] > 0.0) ++rows_;
    }
  }
  set_noise(noise);
}

void Problem::set_noise(const NoiseModel& noise) {
  noise_ = noise;
  whitener_ = Whitener(series_, noise_);
  RowMatrix y = force_;
  whitener_.apply(y);
  whitened_force_ = y.col(0);
}

void Problem::columns(const ModelSpec& spec, RowMatrix& out) const {
  const auto width = static_cast<Eigen::Index>(spec.coefficient_count());
  out.resize(force_.size(), width);
  Eigen::Index row = 0;
  for (const Series& each : series_) {
    model::RunningModel running(spec, each.excitation.reference);
    running.reset(each.nodes.front());
    for (const model::Instant& node : each.nodes) {
      running.step_columns(node, {out.data() + row * width, static_cast<std::size_t>(width)});
      ++row;
    }
  }
}

Eigen::VectorXd Problem::predict(const ModelSpec& spec) const {
  RowMatrix all;
  columns(spec, all);
  const std::vector<double> c = spec.coefficients();
  return all * Eigen::Map<const Eigen::VectorXd>(c.data(), static_cast<Eigen::Index>(c.size()));
}

double Problem::solve(ModelSpec& spec, Eigen::VectorXd& residual) const {
  return Evaluator(series_, whitener_, whitened_force_).solve(spec, residual);
}

Fit Problem::fit(ModelSpec spec, int iterations) const {
  constexpr double kLongestStep = 1.5;  // sizes of a parameter: a factor of 4.5 where it is searched by its logarithm
  const std::vector<FreeNumber> numbers = free_parameters(spec);
  const auto count = static_cast<Eigen::Index>(numbers.size());
  Evaluator evaluator(series_, whitener_, whitened_force_);
  ModelSpec trial = spec;
  LeastSquaresProblem search;
  search.lower.resize(count);
  search.upper.resize(count);
  search.longest_step.resize(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const model::Parameter& parameter = parameter_of(spec, numbers[static_cast<std::size_t>(i)]);
    search.lower[i] = to_search(parameter, parameter.lower);
    search.upper[i] = to_search(parameter, parameter.upper);
    search.longest_step[i] = kLongestStep * search_scale(parameter);
  }
  search.residual = [&](const Eigen::VectorXd& u, Eigen::VectorXd& residual) {
    trial = spec;
    set_coordinates(trial, numbers, u);
    evaluator.solve(trial, residual);
  };
  search.accepted = [&] {
    evaluator.keep();
    spec = trial;
  };
  search.difference_steps = [&](const Eigen::VectorXd& u) {
    Eigen::VectorXd steps(count);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const double moved = value_of(spec, numbers[i]) + difference_step(spec, numbers[i]);
      steps[at] = to_search(parameter_of(spec, numbers[i]), moved) - u[at];
    }
    return steps;
  };
  LeastSquaresResult found = minimise_squares(search, coordinates(spec, numbers), iterations);

  Fit out;
  for (const FreeNumber& number : numbers)
    out.at_bound.push_back(at_bound(parameter_of(spec, number), value_of(spec, number)));
  out.spec = std::move(spec);
  out.noise = noise_;
  out.chi2 = found.squares;
  out.sum_log = whitener_.sum_log();
  out.rows = rows_;
  out.log_likelihood = -0.5 * (out.chi2 + out.sum_log);
  out.residual = std::move(found.residual);
  out.evaluations = found.evaluations;
  out.stop = found.stop;
  return out;
}

double Problem::log_likelihood(const ModelSpec& spec, const NoiseModel& noise) const {
  const Eigen::VectorXd residual = force_ - predict(spec);
  return NoiseScore(series_, {residual.data(), static_cast<std::size_t>(residual.size())})(noise);
}

NoiseModel Problem::estimate_noise(const ModelSpec& spec) const {
  const Eigen::VectorXd residual = force_ - predict(spec);
  NoiseScore score(series_, {residual.data(), static_cast<std::size_t>(residual.size())});
  NoiseModel best = noise_;
  best.coloured_N = 0.0;
  best.white_N = score.rms_N();  // white alone has a closed answer: w^2 = mean of n_k r_k^2 over the bins
  double best_score = score(best);
  const double all = best.white_N;
  const double instrument = noise_.white_N;
  for (const double correlation : {0.01, 0.1, 1.0, 10.0, 100.0, 1000.0}) {
    for (const double share : {0.05, 0.2, 0.5, 1.0, 3.0}) {
      const NoiseModel trial{std::min(all, instrument), share * all, correlation};
      if (const double value = score(trial); value > best_score) {
        best_score = value;
        best = trial;
      }
    }
  }
  // Not along the ridge: there the noise takes up more of what an explanation leaves, and of the pairs of one looked-at
  // seed (20261152) one lost its name to a larger noise.
  climb(best, best_score, {.width = {0.1, 0.7, 1.0, 0.0}, .passes = 10, .shortest_s = 5e-3, .longest_s = 3e3}, score);
  return best;
}

}  // namespace isorig::identify
