#pragma once
#include <Eigen/Dense>
#include <memory>
#include <span>
#include <vector>

#include "identify/diagnose/fit/whiten.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// Solves the coefficients of one model again and again while a search changes its parameters, and computes only the
/// columns again that a changed parameter enters: a time constant its own column, a lag all columns before it, play and
/// slip every column.
class Evaluator {
 public:
  /// What is passed must outlive it.
  Evaluator(std::span<const Series> series, const Whitener& whitener, const Eigen::VectorXd& whitened_force);

  /// Coefficients for the spec's parameters by least squares, signs obeyed: set in `spec`, whitened residual
  /// out. Returns its sum of squares. All specs must have the same parts.
  double solve(model::ModelSpec& spec, Eigen::VectorXd& residual);
  /// What was solved last is what later specs are compared with.
  void keep();

 private:
  struct Column {
    std::size_t part = 0;
    std::size_t stage_position = 0;  ///< among all columns in the order of the stages
  };
  struct State {
    std::vector<std::vector<double>> parameters;               ///< per part; empty: nothing computed yet
    std::shared_ptr<const std::vector<model::Instant>> nodes;  ///< of all series, after play and slip
    Eigen::MatrixXd raw;                                       ///< per column of the spec, before slack, lag and delay
    Eigen::MatrixXd white;
    Eigen::MatrixXd gram;
    Eigen::VectorXd right;
  };
  void lay_out(const model::ModelSpec& spec);
  /// `last_` as `kept_`: only the columns that differ are copied.
  void go_back();
  /// What the specimen sees under the spec's play and slip.
  [[nodiscard]] std::vector<model::Instant> moved_nodes(const model::ModelSpec& spec) const;
  void simulate(const model::ModelSpec& spec, const std::vector<bool>& parts, State& state) const;
  /// Slack, lag and delay act on the columns `which`, then they are whitened.
  [[nodiscard]] RowMatrix seen(const model::ModelSpec& spec, const State& state,
                               const std::vector<Eigen::Index>& which) const;
  void solve_coefficients(model::ModelSpec& spec, const State& state) const;

  std::span<const Series> series_;
  const Whitener& whitener_;
  const Eigen::VectorXd& force_;
  std::vector<Column> columns_;
  std::vector<std::size_t> shapes_;          ///< parts that act on columns, in the order of the stages
  std::vector<std::size_t> columns_before_;  ///< each of them: how many columns it acts on
  std::vector<Eigen::Index> by_stage_;       ///< columns in the order of the stages
  std::vector<model::Sign> signs_;
  std::vector<bool> fixed_;
  bool piecewise_ = false;
  bool laid_out_ = false;
  State kept_, last_;
  std::vector<Eigen::Index> touched_;  ///< columns in which the two differ
};

}  // namespace isorig::identify
