#include "identify/diagnose/fit/fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "identify/diagnose/fit/evaluator.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Parameter;

struct Handle {
  std::size_t part;
  std::size_t index;
  const Parameter* parameter;
};

std::vector<Handle> searched(const ModelSpec& spec) {
  std::vector<Handle> handles;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& law = *spec.parts[p].law;
    if (spec.parts[p].fixed) continue;
    for (std::size_t i = 0; i < law.parameters.size(); ++i) {
      // The time of an event is found by scanning: no gradient leads to it.
      if (!law.parameters[i].fixed && law.parameters[i].name != "time_s") handles.push_back({p, i, &law.parameters[i]});
    }
  }
  return handles;
}

double to_search(const Parameter& parameter, double value) {
  return parameter.logarithmic ? std::log(value) : value;
}
double from_search(const Parameter& parameter, double value) {
  const double raw = parameter.logarithmic ? std::exp(value) : value;
  return std::clamp(raw, parameter.lower, parameter.upper);
}
double scale_of(const Parameter& parameter) {
  return parameter.logarithmic ? 1.0 : std::min(parameter.upper - parameter.lower, 1.0);
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
  const std::vector<Handle> handles = searched(spec);
  const auto p = static_cast<Eigen::Index>(handles.size());
  Fit out;
  Eigen::VectorXd residual;
  const auto set = [&](ModelSpec& target, const Eigen::VectorXd& u) {
    for (Eigen::Index i = 0; i < p; ++i)
      target.parts[handles[i].part].parameters[handles[i].index] = from_search(*handles[i].parameter, u[i]);
  };
  Eigen::VectorXd u(p);
  for (Eigen::Index i = 0; i < p; ++i)
    u[i] = to_search(*handles[i].parameter, spec.parts[handles[i].part].parameters[handles[i].index]);
  const auto clamp = [&](Eigen::VectorXd& v) {
    for (Eigen::Index i = 0; i < p; ++i)
      v[i] = std::clamp(v[i],
                        to_search(*handles[i].parameter, std::max(handles[i].parameter->lower,
                                                                  handles[i].parameter->logarithmic ? 1e-300 : -1e300)),
                        to_search(*handles[i].parameter, handles[i].parameter->upper));
  };
  Evaluator evaluator(series_, whitener_, whitened_force_);
  double chi2 = evaluator.solve(spec, residual);
  evaluator.keep();
  out.evaluations = 1;
  double damping = 1e-2;
  for (int iteration = 0; iteration < iterations && p > 0; ++iteration) {
    Eigen::MatrixXd jacobian(residual.size(), p);
    for (Eigen::Index i = 0; i < p; ++i) {
      const Parameter& parameter = *handles[i].parameter;
      double h = 2e-4 * scale_of(parameter);
      Eigen::VectorXd moved = u;
      moved[i] += h;
      if (moved[i] > to_search(parameter, parameter.upper)) {
        h = -h;
        moved[i] = u[i] + h;
      }
      ModelSpec trial = spec;
      set(trial, moved);
      Eigen::VectorXd r;
      evaluator.solve(trial, r);
      ++out.evaluations;
      jacobian.col(i) = (r - residual) / h;
    }
    const Eigen::MatrixXd hessian = jacobian.transpose() * jacobian;
    const Eigen::VectorXd gradient = jacobian.transpose() * residual;
    bool improved = false;
    double gained = 0.0, moved_by = 0.0;
    for (int attempt = 0; attempt < 8; ++attempt) {
      Eigen::MatrixXd damped = hessian;
      for (Eigen::Index i = 0; i < p; ++i) damped(i, i) += damping * hessian(i, i) + 1e-12;
      Eigen::VectorXd step = -damped.ldlt().solve(gradient);
      for (Eigen::Index i = 0; i < p; ++i)
        step[i] = std::clamp(step[i], -1.5 * scale_of(*handles[i].parameter), 1.5 * scale_of(*handles[i].parameter));
      Eigen::VectorXd next = u + step;
      clamp(next);
      ModelSpec trial = spec;
      set(trial, next);
      Eigen::VectorXd r;
      const double value = evaluator.solve(trial, r);
      ++out.evaluations;
      if (value < chi2) {
        evaluator.keep();
        gained = chi2 - value;
        moved_by = (next - u).norm();
        u = next;
        chi2 = value;
        spec = std::move(trial);
        residual = std::move(r);
        damping = std::max(damping * 0.2, 1e-9);
        improved = true;
        break;
      }
      damping *= 6.0;
    }
    if (!improved || gained < 1e-3 || (gained < 0.05 && moved_by < 1e-4)) break;
  }
  for (Eigen::Index i = 0; i < p; ++i) {
    const Parameter& parameter = *handles[i].parameter;
    const double value = spec.parts[handles[i].part].parameters[handles[i].index];
    out.at_bound.push_back(value <= parameter.lower * (1 + 1e-9) + 1e-12 || value >= parameter.upper * (1 - 1e-9));
  }
  out.spec = std::move(spec);
  out.noise = noise_;
  out.chi2 = chi2;
  out.sum_log = whitener_.sum_log();
  out.rows = rows_;
  out.log_likelihood = -0.5 * (chi2 + whitener_.sum_log());
  out.residual = std::move(residual);
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
  best.white_N = score.rms_N();  // white alone has a closed answer
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
  // Coordinate search on the logarithms.
  std::array<double, 3> width{0.1, 0.7, 1.0};
  for (int pass = 0; pass < 10; ++pass) {
    for (int i = 0; i < 3; ++i) {
      if (i > 0 && best.coloured_N == 0.0) continue;
      for (const double direction : {1.0, -1.0}) {
        NoiseModel trial = best;
        double& value = i == 0 ? trial.white_N : i == 1 ? trial.coloured_N : trial.correlation_s;
        value *= std::exp(direction * width[i]);
        if (i == 2) value = std::clamp(value, 5e-3, 3e3);
        if (const double s = score(trial); s > best_score) {
          best_score = s;
          best = trial;
          break;
        }
      }
    }
    for (double& w : width) w *= 0.75;
  }
  return best;
}

}  // namespace isorig::identify
