#include "identify/diagnose/fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Parameter;
using model::Sign;

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
      if (!law.parameters[i].fixed && law.parameters[i].name != "time_s")
        handles.push_back({p, i, &law.parameters[i]});
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

/// Least squares with sign constraints on the normal equations: coefficients that would break their sign are
/// taken out, worst first, and let in again when that helps (few coefficients, so this is exact in practice).
Eigen::VectorXd solve_signed(const Eigen::MatrixXd& gram, const Eigen::VectorXd& right,
                             const std::vector<Sign>& signs) {
  const Eigen::Index m = gram.rows();
  Eigen::VectorXd scale(m);
  for (Eigen::Index i = 0; i < m; ++i) scale[i] = gram(i, i) > 0.0 ? 1.0 / std::sqrt(gram(i, i)) : 0.0;
  std::vector<bool> out(static_cast<std::size_t>(m), false);
  for (Eigen::Index i = 0; i < m; ++i) out[i] = scale[i] == 0.0;
  Eigen::VectorXd solution = Eigen::VectorXd::Zero(m);
  for (int pass = 0; pass < 3 * m + 3; ++pass) {
    std::vector<Eigen::Index> in;
    for (Eigen::Index i = 0; i < m; ++i)
      if (!out[i]) in.push_back(i);
    const auto k = static_cast<Eigen::Index>(in.size());
    Eigen::MatrixXd a(k, k);
    Eigen::VectorXd b(k);
    for (Eigen::Index i = 0; i < k; ++i) {
      b[i] = right[in[i]] * scale[in[i]];
      for (Eigen::Index j = 0; j < k; ++j) a(i, j) = gram(in[i], in[j]) * scale[in[i]] * scale[in[j]];
      a(i, i) += 1e-13;
    }
    const Eigen::VectorXd x = a.ldlt().solve(b);
    solution.setZero();
    Eigen::Index worst = -1;
    double worst_value = -1e-12;
    for (Eigen::Index i = 0; i < k; ++i) {
      const double wrong = signs[in[i]] == Sign::kNonNegative   ? x[i]
                           : signs[in[i]] == Sign::kNonPositive ? -x[i]
                                                                : 0.0;
      if (wrong < worst_value) {
        worst_value = wrong;
        worst = in[i];
      }
      solution[in[i]] = x[i] * scale[in[i]];
    }
    if (worst >= 0) {
      out[worst] = true;
      continue;
    }
    // A coefficient left out comes back if its gradient now points the allowed way.
    Eigen::Index back = -1;
    double gain = 1e-9;
    const Eigen::VectorXd gradient = right - gram * solution;
    for (Eigen::Index i = 0; i < m; ++i) {
      if (!out[i] || scale[i] == 0.0) continue;
      const double slope = gradient[i] * scale[i] * (signs[i] == Sign::kNonPositive ? -1.0 : 1.0);
      if (slope > gain * std::sqrt(right.squaredNorm()) && slope > gain) {
        gain = slope;
        back = i;
      }
    }
    if (back < 0 || pass > 2 * m) break;
    out[back] = false;
  }
  return solution;
}

}  // namespace

double whiten(std::span<const Series> series, const NoiseModel& noise, RowMatrix& columns) {
  const Eigen::Index width = columns.cols();
  const double white2 = noise.white_N * noise.white_N, coloured2 = noise.coloured_N * noise.coloured_N;
  double sum_log = 0.0;
  Eigen::Index row = 0;
  std::array<double, 48> state;
  for (const Series& each : series) {
    double variance = coloured2;
    std::fill_n(state.begin(), width, 0.0);
    for (std::size_t k = 0; k < each.nodes.size(); ++k, ++row) {
      double* values = &columns(row, 0);
      if (coloured2 == 0.0) {
        const double s = each.count[k] > 0.0 ? std::sqrt(each.count[k]) / noise.white_N : 0.0;
        for (Eigen::Index c = 0; c < width; ++c) values[c] *= s;
        if (s > 0.0) sum_log -= 2.0 * std::log(s);
        continue;
      }
      if (k > 0) {
        const double decay = std::exp(-each.nodes[k].dt_s / noise.correlation_s);
        for (Eigen::Index c = 0; c < width; ++c) state[c] *= decay;
        variance = variance * decay * decay + coloured2 * (1.0 - decay * decay);
      }
      if (each.count[k] == 0.0) {
        std::fill_n(values, width, 0.0);
        continue;
      }
      const double total = variance + white2 / each.count[k];
      const double gain = variance / total, s = 1.0 / std::sqrt(total);
      for (Eigen::Index c = 0; c < width; ++c) {
        const double innovation = values[c] - state[c];
        state[c] += gain * innovation;
        values[c] = innovation * s;
      }
      variance *= 1.0 - gain;
      sum_log += std::log(total);
    }
  }
  return sum_log;
}

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
  RowMatrix y = force_;
  sum_log_ = whiten(series_, noise_, y);
  whitened_force_ = y.col(0);
}

void Problem::columns(const ModelSpec& spec, RowMatrix& out) const {
  const auto width = static_cast<Eigen::Index>(spec.coefficient_count());
  out.resize(force_.size(), width);
  Eigen::Index row = 0;
  for (const Series& each : series_) {
    model::RunningModel running(spec, each.drive.reference);
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
  model::follow_arms(spec);
  std::vector<Sign> signs;
  std::vector<bool> fixed;
  bool piecewise = false;
  for (const auto& part : spec.parts) {
    for (const auto& coefficient : part.law->coefficients) {
      signs.push_back(coefficient.sign);
      fixed.push_back(part.fixed);
    }
    piecewise = piecewise || part.physics->stage == model::Stage::kSpecimenShape ||
                part.physics->name == "cell_nonlinearity";
  }
  RowMatrix a;
  for (int pass = 0; pass < (piecewise ? 4 : 1); ++pass) {
    columns(spec, a);
    whiten(series_, noise_, a);
    const Eigen::Index m = a.cols();
    Eigen::VectorXd b = whitened_force_;
    std::vector<double> c = spec.coefficients();
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < m; ++i) {
      if (fixed[i])
        b -= a.col(i) * c[i];
      else
        free.push_back(i);
    }
    if (static_cast<Eigen::Index>(free.size()) == m) {
      Eigen::MatrixXd gram = a.transpose() * a;
      const Eigen::VectorXd right = a.transpose() * b;
      const Eigen::VectorXd x = solve_signed(gram, right, signs);
      residual = b - a * x;
      for (Eigen::Index i = 0; i < m; ++i) c[i] = x[i];
    } else {
      Eigen::MatrixXd picked(a.rows(), free.size());
      std::vector<Sign> picked_signs;
      for (std::size_t i = 0; i < free.size(); ++i) {
        picked.col(static_cast<Eigen::Index>(i)) = a.col(free[i]);
        picked_signs.push_back(signs[free[i]]);
      }
      const Eigen::VectorXd x =
          solve_signed(picked.transpose() * picked, picked.transpose() * b, picked_signs);
      residual = b - picked * x;
      for (std::size_t i = 0; i < free.size(); ++i) c[free[i]] = x[static_cast<Eigen::Index>(i)];
    }
    spec.set_coefficients(c);
  }
  return residual.squaredNorm();
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
      v[i] = std::clamp(
          v[i],
          to_search(*handles[i].parameter, std::max(handles[i].parameter->lower,
                                                    handles[i].parameter->logarithmic ? 1e-300 : -1e300)),
          to_search(*handles[i].parameter, handles[i].parameter->upper));
  };
  double chi2 = solve(spec, residual);
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
      solve(trial, r);
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
        step[i] = std::clamp(step[i], -1.5 * scale_of(*handles[i].parameter),
                             1.5 * scale_of(*handles[i].parameter));
      Eigen::VectorXd next = u + step;
      clamp(next);
      ModelSpec trial = spec;
      set(trial, next);
      Eigen::VectorXd r;
      const double value = solve(trial, r);
      ++out.evaluations;
      if (value < chi2) {
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
    out.at_bound.push_back(value <= parameter.lower * (1 + 1e-9) + 1e-12 ||
                           value >= parameter.upper * (1 - 1e-9));
  }
  out.spec = std::move(spec);
  out.noise = noise_;
  out.chi2 = chi2;
  out.sum_log = sum_log_;
  out.rows = rows_;
  out.log_likelihood = -0.5 * (chi2 + sum_log_);
  out.residual = std::move(residual);
  return out;
}

double Problem::log_likelihood(const ModelSpec& spec, const NoiseModel& noise) const {
  RowMatrix r = force_ - predict(spec);
  const double sum_log = whiten(series_, noise, r);
  return -0.5 * (r.squaredNorm() + sum_log);
}

NoiseModel Problem::estimate_noise(const ModelSpec& spec) const {
  const RowMatrix raw = force_ - predict(spec);
  RowMatrix r;
  const auto score = [&](const NoiseModel& noise) {
    r = raw;
    const double sum_log = whiten(series_, noise, r);
    return -0.5 * (r.squaredNorm() + sum_log);
  };
  NoiseModel best = noise_;
  best.coloured_N = 0.0;
  // White alone has a closed answer.
  {
    best.white_N = 1.0;
    r = raw;
    whiten(series_, best, r);
    best.white_N = std::sqrt(r.squaredNorm() / static_cast<double>(rows_));
  }
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
