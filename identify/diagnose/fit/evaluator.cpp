#include "identify/diagnose/fit/evaluator.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "identify/diagnose/fit/signed_least_squares.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Sign;
using model::Stage;

bool acts_on_columns(Stage stage) {
  return stage == Stage::kSpecimenShape || stage == Stage::kSensorLag || stage == Stage::kSensorDelay;
}

/// Anderson's acceleration, of depth one, of a fixed point c = g(c) (Walker & Ni 2011, SIAM J. Numer. Anal. 49:1715):
/// with f = g(c) - c, the next c is g less the share of its last change that would have made f least if f were linear.
/// An error that each pass halves is gone in four passes instead of twenty. Lengths are those of the columns, so that
/// no unit matters; a coefficient whose sign would turn takes g.
class FixedPoint {
 public:
  explicit FixedPoint(const std::vector<Sign>& signs) : signs_(signs) {}

  [[nodiscard]] std::vector<double> next(const std::vector<double>& from, const std::vector<double>& to,
                                         const Eigen::VectorXd& weights) {
    std::vector<double> out = to, step(to.size());
    for (std::size_t i = 0; i < to.size(); ++i) step[i] = to[i] - from[i];
    if (!last_to_.empty()) {
      double along = 0.0, squares = 0.0;
      for (std::size_t i = 0; i < to.size(); ++i) {
        const double change = step[i] - last_step_[i], weight = weights[static_cast<Eigen::Index>(i)];
        along += weight * step[i] * change;
        squares += weight * change * change;
      }
      const double share = squares > 0.0 ? along / squares : 0.0;
      for (std::size_t i = 0; i < to.size(); ++i) {
        const double moved = to[i] - share * (to[i] - last_to_[i]);
        if (signs_[i] == Sign::kFree || moved * to[i] > 0.0) out[i] = moved;
      }
    }
    last_to_ = to;
    last_step_ = std::move(step);
    return out;
  }

 private:
  const std::vector<Sign>& signs_;
  std::vector<double> last_to_, last_step_;
};

std::unique_ptr<model::Process> started(const model::Part& part, const Series& series) {
  auto process = part.law->make_table ? part.law->make_table(part.table, series.excitation.reference)
                                      : part.law->make(part.parameters, series.excitation.reference);
  process->reset(series.nodes.front());
  return process;
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
    piecewise_ = piecewise_ || part.law->traits.uses_coefficients;
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

std::vector<model::Instant> Evaluator::moved_nodes(const ModelSpec& spec) const {
  std::vector<model::Instant> out;
  out.reserve(static_cast<std::size_t>(force_.size()));
  for (const Series& each : series_) {
    std::vector<std::unique_ptr<model::Process>> movers;
    for (const auto& part : spec.parts)
      if (model::stage_of(part) == Stage::kKinematics) movers.push_back(started(part, each));
    for (model::Instant node : each.nodes) {
      if (std::isnan(node.slide_mm)) node.slide_mm = node.step_mm;
      for (const auto& mover : movers) mover->move(node);
      out.push_back(node);
    }
  }
  return out;
}

void Evaluator::simulate(const ModelSpec& spec, const std::vector<bool>& parts, State& state) const {
  Eigen::Index column = 0;
  std::vector<double> values;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const Stage stage = model::stage_of(spec.parts[p]);
    const Eigen::Index first = column;
    column += static_cast<Eigen::Index>(spec.parts[p].law->coefficients.size());
    if (!parts[p] || column == first || stage == Stage::kKinematics || acts_on_columns(stage)) continue;
    values.resize(static_cast<std::size_t>(column - first));
    Eigen::Index row = 0;
    for (const Series& each : series_) {
      const auto process = started(spec.parts[p], each);
      for (std::size_t k = 0; k < each.nodes.size(); ++k, ++row) {
        std::ranges::fill(values, 0.0);
        process->force((*state.nodes)[static_cast<std::size_t>(row)], values.data());
        for (std::size_t i = 0; i < values.size(); ++i)
          state.raw(row, first + static_cast<Eigen::Index>(i)) = values[i];
      }
    }
  }
}

RowMatrix Evaluator::seen(const ModelSpec& spec, const State& state, const std::vector<Eigen::Index>& which) const {
  RowMatrix out(state.raw.rows(), static_cast<Eigen::Index>(which.size()));
  for (std::size_t i = 0; i < which.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = state.raw.col(which[i]);
  if (!shapes_.empty()) {
    const std::vector<double> all = spec.coefficients();
    std::vector<double> coefficients;
    // NOLINTNEXTLINE(performance-inefficient-vector-operation): ten numbers, and only where an effect shapes columns.
    for (const Eigen::Index c : which) coefficients.push_back(all[static_cast<std::size_t>(c)]);
    std::vector<std::size_t> reach;
    for (const std::size_t before : columns_before_)
      reach.push_back(static_cast<std::size_t>(std::ranges::count_if(
          which, [&](Eigen::Index c) { return columns_[static_cast<std::size_t>(c)].stage_position < before; })));
    Eigen::Index row = 0;
    for (const Series& each : series_) {
      std::vector<std::unique_ptr<model::Process>> shapers;
      for (const std::size_t p : shapes_) shapers.push_back(started(spec.parts[p], each));
      for (std::size_t k = 0; k < each.nodes.size(); ++k) {
        const model::Instant& node = (*state.nodes)[static_cast<std::size_t>(row)];
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
  Eigen::VectorXd right = state.right, known = Eigen::VectorXd::Zero(right.size());
  for (std::size_t i = 0; i < c.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    if (fixed_[i]) {
      right -= state.gram.col(at) * c[i];
      known[at] = c[i];
    } else {
      free.push_back(at);
      signs.push_back(signs_[i]);
    }
  }
  Reduced reduced;
  if (!reduce_normal_equations(state.gram(free, free), right(free), reduced))
    reduced = reduce_columns(state.white(Eigen::all, free), force_ - state.white * known);
  const Eigen::VectorXd x = solve_signed(reduced, signs);
  for (std::size_t i = 0; i < free.size(); ++i) c[static_cast<std::size_t>(free[i])] = x[static_cast<Eigen::Index>(i)];
  spec.set_coefficients(c);
}

double Evaluator::solve(ModelSpec& spec, Eigen::VectorXd& residual) {
  model::follow_arms(spec);
  if (!laid_out_) lay_out(spec);
  go_back();
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
  if (all) state.nodes = std::make_shared<const std::vector<model::Instant>>(moved_nodes(spec));
  simulate(spec, moved, state);
  state.parameters.clear();
  for (const auto& part : spec.parts) state.parameters.push_back(part.parameters);
  std::vector<Eigen::Index> which;
  for (const Eigen::Index c : by_stage_)
    if (reshaped || moved[columns_[static_cast<std::size_t>(c)].part]) which.push_back(c);
  touched_ = which;

  // The columns of a law with `uses_coefficients` depend on the coefficients of the pass before, so the solution is
  // iterated. For slack a single pass removes the error; at the corner of a ceiling each pass halves it.
  constexpr int kMostPasses = 12;
  constexpr double kSettled = 1e-7;
  FixedPoint settling(signs_);
  for (int pass = 0;; ++pass) {
    const std::vector<double> before = spec.coefficients();
    if (!which.empty()) {
      const RowMatrix fresh = seen(spec, state, which);
      for (std::size_t i = 0; i < which.size(); ++i)
        state.white.col(which[i]) = fresh.col(static_cast<Eigen::Index>(i));
      if (static_cast<Eigen::Index>(which.size()) == state.white.cols()) {
        state.gram.noalias() = state.white.transpose() * state.white;
        state.right.noalias() = state.white.transpose() * force_;
      } else {
        for (const Eigen::Index c : which) {
          const Eigen::VectorXd products = state.white.transpose() * state.white.col(c);
          state.gram.col(c) = products;
          state.gram.row(c) = products.transpose();
          state.right[c] = state.white.col(c).dot(force_);
        }
      }
    }
    solve_coefficients(spec, state);
    if (!piecewise_ || pass + 1 == kMostPasses) break;
    const std::vector<double> after = spec.coefficients();
    double change = 0.0, size = 0.0;
    for (std::size_t i = 0; i < after.size(); ++i) {
      change = std::max(change, std::fabs(after[i] - before[i]));
      size = std::max(size, std::fabs(after[i]));
    }
    if (change <= kSettled * size) break;
    spec.set_coefficients(settling.next(before, after, state.gram.diagonal()));
  }
  const std::vector<double> c = spec.coefficients();
  residual = force_ - state.white * Eigen::Map<const Eigen::VectorXd>(c.data(), state.white.cols());
  return residual.squaredNorm();
}

void Evaluator::go_back() {
  if (kept_.parameters.empty()) {
    last_.parameters.clear();
    return;
  }
  for (const Eigen::Index c : touched_) {
    last_.raw.col(c) = kept_.raw.col(c);
    last_.white.col(c) = kept_.white.col(c);
  }
  touched_.clear();
  last_.parameters = kept_.parameters;
  last_.nodes = kept_.nodes;
  last_.gram = kept_.gram;
  last_.right = kept_.right;
}

void Evaluator::keep() {
  if (kept_.parameters.empty()) {
    kept_ = last_;
  } else {
    for (const Eigen::Index c : touched_) {
      kept_.raw.col(c) = last_.raw.col(c);
      kept_.white.col(c) = last_.white.col(c);
    }
    kept_.parameters = last_.parameters;
    kept_.nodes = last_.nodes;
    kept_.gram = last_.gram;
    kept_.right = last_.right;
  }
  touched_.clear();
}

}  // namespace isorig::identify
