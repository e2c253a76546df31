#include "identify/diagnose/fit/evaluator.hpp"

#include <algorithm>
#include <numeric>

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Sign;
using model::Stage;

bool acts_on_columns(Stage stage) {
  return stage == Stage::kSpecimenShape || stage == Stage::kSensorLag || stage == Stage::kSensorDelay;
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
      const double wrong = signs[in[i]] == Sign::kNonNegative ? x[i] : signs[in[i]] == Sign::kNonPositive ? -x[i] : 0.0;
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

Evaluator::Evaluator(std::span<const Series> series, const Whitener& whitener, const Eigen::VectorXd& whitened_force)
    : series_(series), whitener_(whitener), force_(whitened_force) {}

void Evaluator::lay_out(const ModelSpec& spec) {
  laid_out_ = true;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& part = spec.parts[p];
    for (const auto& coefficient : part.law->coefficients) {
      columns_.push_back({p, 0});
      signs_.push_back(coefficient.sign);
      fixed_.push_back(part.fixed);
    }
    piecewise_ =
        piecewise_ || part.physics->stage == Stage::kSpecimenShape || part.physics->name == "cell_nonlinearity";
  }
  std::vector<std::size_t> parts(spec.parts.size());
  std::iota(parts.begin(), parts.end(), std::size_t{0});
  std::ranges::stable_sort(parts, {}, [&](std::size_t p) { return model::stage_of(spec.parts[p]); });
  for (const std::size_t p : parts) {
    if (acts_on_columns(model::stage_of(spec.parts[p]))) {
      shapes_.push_back(p);
      columns_before_.push_back(by_stage_.size());
    }
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      if (columns_[c].part != p) continue;
      columns_[c].stage_position = by_stage_.size();
      by_stage_.push_back(static_cast<Eigen::Index>(c));
    }
  }
}

void Evaluator::simulate(const ModelSpec& spec, const std::vector<bool>& parts, Eigen::MatrixXd& raw) const {
  ModelSpec some;
  std::vector<Eigen::Index> target;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const bool moves = model::stage_of(spec.parts[p]) == Stage::kKinematics;
    if (!moves && (!parts[p] || acts_on_columns(model::stage_of(spec.parts[p])))) continue;
    some.parts.push_back(spec.parts[p]);
    for (std::size_t c = 0; c < columns_.size(); ++c)
      if (columns_[c].part == p) target.push_back(static_cast<Eigen::Index>(c));
  }
  std::vector<double> values(target.size());
  Eigen::Index row = 0;
  for (const Series& each : series_) {
    model::RunningModel running(some, each.excitation.reference);
    running.reset(each.nodes.front());
    for (const model::Instant& node : each.nodes) {
      running.step_columns(node, values);
      for (std::size_t i = 0; i < target.size(); ++i) raw(row, target[i]) = values[i];
      ++row;
    }
  }
}

RowMatrix Evaluator::seen(const ModelSpec& spec, const Eigen::MatrixXd& raw,
                          const std::vector<Eigen::Index>& which) const {
  RowMatrix out(raw.rows(), static_cast<Eigen::Index>(which.size()));
  for (std::size_t i = 0; i < which.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = raw.col(which[i]);
  if (!shapes_.empty()) {
    const std::vector<double> all = spec.coefficients();
    std::vector<double> coefficients;
    for (const Eigen::Index c : which) coefficients.push_back(all[static_cast<std::size_t>(c)]);
    std::vector<std::size_t> reach;
    for (const std::size_t before : columns_before_)
      reach.push_back(static_cast<std::size_t>(std::ranges::count_if(
          which, [&](Eigen::Index c) { return columns_[static_cast<std::size_t>(c)].stage_position < before; })));
    Eigen::Index row = 0;
    for (const Series& each : series_) {
      std::vector<std::unique_ptr<model::Process>> movers, shapers;
      const auto start = [&](const model::Part& part) {
        auto process = part.law->make_table ? part.law->make_table(part.table, each.excitation.reference)
                                            : part.law->make(part.parameters, each.excitation.reference);
        process->reset(each.nodes.front());
        return process;
      };
      for (const auto& part : spec.parts)
        if (model::stage_of(part) == Stage::kKinematics) movers.push_back(start(part));
      for (const std::size_t p : shapes_) shapers.push_back(start(spec.parts[p]));
      for (model::Instant node : each.nodes) {
        for (const auto& mover : movers) mover->move(node);
        double* values = out.data() + row * out.cols();
        for (std::size_t s = 0; s < shapers.size(); ++s)
          shapers[s]->shape(node, {values, reach[s]}, {coefficients.data(), reach[s]});
        ++row;
      }
    }
  }
  whitener_.apply(out);
  return out;
}

void Evaluator::solve_coefficients(ModelSpec& spec, const State& state) const {
  std::vector<double> c = spec.coefficients();
  std::vector<Eigen::Index> free;
  std::vector<Sign> signs;
  Eigen::VectorXd right = state.right;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    if (fixed_[i]) {
      right -= state.gram.col(at) * c[i];
    } else {
      free.push_back(at);
      signs.push_back(signs_[i]);
    }
  }
  const Eigen::VectorXd x = solve_signed(state.gram(free, free), right(free), signs);
  for (std::size_t i = 0; i < free.size(); ++i) c[static_cast<std::size_t>(free[i])] = x[static_cast<Eigen::Index>(i)];
  spec.set_coefficients(c);
}

double Evaluator::solve(ModelSpec& spec, Eigen::VectorXd& residual) {
  model::follow_arms(spec);
  if (!laid_out_) lay_out(spec);
  last_ = kept_;
  State& state = last_;
  std::vector<bool> moved(spec.parts.size(), false);
  bool all = state.parameters.empty();
  if (all) {
    const auto width = static_cast<Eigen::Index>(columns_.size());
    state.raw.resize(force_.size(), width);
    state.white.resize(force_.size(), width);
    state.gram.resize(width, width);
    state.right.resize(width);
  }
  bool reshaped = piecewise_;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    moved[p] = state.parameters.empty() || spec.parts[p].parameters != state.parameters[p];
    if (!moved[p]) continue;
    const Stage stage = model::stage_of(spec.parts[p]);
    all = all || stage == Stage::kKinematics;
    reshaped = reshaped || acts_on_columns(stage);
  }
  if (all) moved.assign(moved.size(), true);
  if (std::ranges::find(moved, true) != moved.end()) simulate(spec, moved, state.raw);
  state.parameters.clear();
  for (const auto& part : spec.parts) state.parameters.push_back(part.parameters);
  std::vector<Eigen::Index> which;
  for (const Eigen::Index c : by_stage_)
    if (reshaped || moved[columns_[static_cast<std::size_t>(c)].part]) which.push_back(c);

  for (int pass = 0; pass < (piecewise_ ? 4 : 1); ++pass) {
    if (!which.empty()) {
      const RowMatrix fresh = seen(spec, state.raw, which);
      for (std::size_t i = 0; i < which.size(); ++i)
        state.white.col(which[i]) = fresh.col(static_cast<Eigen::Index>(i));
      for (const Eigen::Index c : which) {
        const Eigen::VectorXd products = state.white.transpose() * state.white.col(c);
        state.gram.col(c) = products;
        state.gram.row(c) = products.transpose();
        state.right[c] = state.white.col(c).dot(force_);
      }
    }
    solve_coefficients(spec, state);
  }
  const std::vector<double> c = spec.coefficients();
  residual = force_ - state.white * Eigen::Map<const Eigen::VectorXd>(c.data(), state.white.cols());
  return residual.squaredNorm();
}

void Evaluator::keep() {
  kept_ = last_;
}

}  // namespace isorig::identify
