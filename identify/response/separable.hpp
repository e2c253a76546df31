#pragma once
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <vector>

#include "base/quantile.hpp"
#include "identify/diagnose/fit/signed_least_squares.hpp"
#include "identify/response/response_data.hpp"
#include "identify/response/response_fit.hpp"
#include "model/stepping.hpp"

namespace isorig::identify::response {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Of a recording that a search sees; the residual is that of all.
inline constexpr std::size_t kMostRows = 5000;

inline double span_of(const std::vector<double>& values) {
  const auto [low, high] = std::ranges::minmax(values);
  return high - low;
}

/// The fit as a separable problem. Nonlinear: log T_i; then per input log w_j with a play; then n and the rest with an
/// exponent. Linear, in this order: per recording its beginning and what each unit had to go; then per input S, C_i, g;
/// then the drift; without inputs the rest.
class Separable {
 public:
  Separable(const std::vector<Data>& data, const Structure& structure, const std::vector<std::vector<bool>>& used)
      : data_(data), s_(structure), inputs_(data[0].inputs.size()) {
    double longest_s = 0.0, shortest_s = 1e300;
    std::vector<double> steps_s;
    for (const Data& each : data) {
      longest_s = std::max(longest_s, each.t_s.back() - each.t_s.front());
      for (std::size_t k = 1; k < each.t_s.size(); ++k) steps_s.push_back(each.t_s[k] - each.t_s[k - 1]);
      noise_ = std::max(noise_, each.output_quality.noise);
      span_ = std::max(span_, span_of(each.output_value));
      rows_ += each.t_s.size();
      begins_.push_back(begin_of(each));
      all_.emplace_back(each.t_s.size());
      std::iota(all_.back().begin(), all_.back().end(), std::size_t{0});
      fitted_.emplace_back();
      const std::size_t every = (each.t_s.size() + kMostRows - 1) / kMostRows;
      const auto& these = used.empty() ? std::vector<bool>{} : used[fitted_.size() - 1];
      for (std::size_t k = 0; k < each.t_s.size(); k += every)
        if (these.empty() || these[k]) fitted_.back().push_back(k);
    }
    shortest_s = 3.0 * base::median(std::move(steps_s));
    noise_ = std::max(noise_, 1e-9 * span_);
    lower_ = VectorXd::Constant(nonlinear(), std::log(shortest_s));
    upper_ = VectorXd::Constant(nonlinear(), std::log(std::max(3.0 * longest_s, 2.0 * shortest_s)));
    Index at = static_cast<Index>(s_.times);
    for (std::size_t j = 0; s_.play && j < inputs_; ++j, ++at) {
      double span = 0.0;
      for (const Data& each : data) span = std::max(span, span_of(each.inputs[j].value));
      lower_[at] = std::log(0.005 * span);
      upper_[at] = std::log(0.5 * span);
    }
    if (s_.exponent) {
      lower_[at] = 0.2, upper_[at] = 3.0;
      ++at;
      const auto& y = data[0].output_value;
      lower_[at] = std::ranges::min(y) - 2.0 * span_, upper_[at] = std::ranges::max(y) + 2.0 * span_;
    }
    lay_out_signs();
  }

  [[nodiscard]] Index nonlinear() const {
    return static_cast<Index>(s_.times + (s_.play ? inputs_ : 0) + (s_.exponent ? 2 : 0));
  }
  [[nodiscard]] std::size_t linear() const { return signs_.size(); }
  [[nodiscard]] const VectorXd& lower() const { return lower_; }
  [[nodiscard]] const VectorXd& upper() const { return upper_; }
  [[nodiscard]] double noise() const { return noise_; }

  /// Rows of recording r: every one, or those that a search sees.
  [[nodiscard]] const std::vector<std::size_t>& rows(std::size_t r, bool every) const {
    return every ? all_[r] : fitted_[r];
  }
  /// The columns of recording r at these rows of it.
  [[nodiscard]] MatrixXd columns(std::size_t r, const VectorXd& u, bool every) const {
    const Data& of = data_[r];
    const auto& rows = this->rows(r, every);
    const auto n = static_cast<Index>(rows.size());
    MatrixXd out = MatrixXd::Zero(n, static_cast<Index>(linear()));
    const auto own = static_cast<Index>(r * per_recording());
    const double time_s =
        s_.exponent
            ? std::exp(u[0]) * std::pow(std::max(std::fabs(begins_[r] - u[2]), 1e-9 * span_) / scale(u), 1.0 - u[1])
            : 0.0;
    for (Index k = 0; k < n; ++k) {
      const double t_s = of.t_s[rows[static_cast<std::size_t>(k)]] - of.t_s[0];
      Index at = own;
      if (inputs_ > 0) out(k, at++) = 1.0;
      if (s_.exponent) {
        out(k, at) = settled(t_s, time_s, u[1]);
      } else {
        for (std::size_t i = 0; i < s_.times; ++i) out(k, at++) = std::exp(-t_s / std::exp(u[static_cast<Index>(i)]));
      }
      if (s_.drift) out(k, drift_column()) = t_s / kHour_s;
      if (inputs_ == 0 && !s_.exponent) out(k, static_cast<Index>(linear()) - 1) = 1.0;
    }
    for (std::size_t j = 0; j < inputs_; ++j) answer(of, j, u, rows, out);
    return out;
  }

  /// What no linear number answers for: with an exponent the rest is searched for.
  [[nodiscard]] VectorXd target(std::size_t r, const VectorXd& u, bool every) const {
    const auto& rows = this->rows(r, every);
    VectorXd out(static_cast<Index>(rows.size()));
    for (std::size_t k = 0; k < rows.size(); ++k) out[static_cast<Index>(k)] = data_[r].output_value[rows[k]];
    if (s_.exponent) out.array() -= u[2];
    return out;
  }

  /// Linear numbers at `u`, and the residual of the rows that a search sees, in noises.
  VectorXd solve(const VectorXd& u, VectorXd* residual) const {
    std::vector<MatrixXd> blocks;
    std::vector<VectorXd> targets;
    Index rows = 0;
    for (std::size_t r = 0; r < data_.size(); ++r) {
      MatrixXd block = columns(r, u, false);
      VectorXd right = target(r, u, false);
      rows += block.rows();
      blocks.push_back(std::move(block));
      targets.push_back(std::move(right));
    }
    MatrixXd all(rows, static_cast<Index>(linear()));
    VectorXd right(rows);
    Index at = 0;
    for (std::size_t r = 0; r < blocks.size(); ++r) {
      all.middleRows(at, blocks[r].rows()) = blocks[r];
      right.segment(at, targets[r].size()) = targets[r];
      at += blocks[r].rows();
    }
    VectorXd x = solve_signed(reduce_columns(all, right), signs_);
    if (residual != nullptr) *residual = (right - all * x) / noise_;
    return x;
  }

  [[nodiscard]] ResponseModel model(const VectorXd& u, const VectorXd& x) const {
    ResponseModel out;
    out.output = data_[0].output;
    std::vector<std::size_t> order(s_.times);
    std::iota(order.begin(), order.end(), 0U);
    std::ranges::sort(order, {}, [&](std::size_t i) { return u[static_cast<Index>(i)]; });
    for (const std::size_t i : order) out.times_s.push_back(std::exp(u[static_cast<Index>(i)]));
    for (std::size_t j = 0; j < inputs_; ++j) {
      ResponseModel::Input input;
      input.column = data_[0].inputs[j].column;
      const Index first = answer_column(j);
      input.immediate = x[first];
      for (const std::size_t i : order) input.retarded.push_back(x[first + 1 + static_cast<Index>(i)]);
      if (s_.play) {
        input.play_width = std::exp(u[static_cast<Index>(s_.times + j)]);
        input.play_gain = x[first + 1 + static_cast<Index>(s_.times)];
      }
      out.inputs.push_back(std::move(input));
    }
    if (s_.drift) out.drift_per_h = x[drift_column()];
    if (inputs_ > 0) return out;
    out.rest = s_.exponent ? u[2] : x[static_cast<Index>(linear()) - 1];
    if (s_.exponent) {
      out.exponent = u[1];
      out.scale = scale(u);
      out.shares = {1.0};
      return out;
    }
    // Every recording has shares of its own; the model's are those of all of them together.
    VectorXd sum = VectorXd::Zero(static_cast<Index>(s_.times));
    // One that falls counts as one that rises: the shares of both would take each other away.
    for (std::size_t r = 0; r < data_.size(); ++r) {
      const auto amplitudes = x.segment(static_cast<Index>(r * per_recording()), static_cast<Index>(s_.times));
      sum += amplitudes.sum() < 0.0 ? VectorXd(-amplitudes) : VectorXd(amplitudes);
    }
    for (const std::size_t i : order)
      out.shares.push_back(sum.sum() != 0.0 ? sum[static_cast<Index>(i)] / sum.sum()
                                            : 1.0 / static_cast<double>(s_.times));
    return out;
  }

 private:
  [[nodiscard]] std::size_t per_recording() const { return (inputs_ > 0 ? 1 : 0) + (s_.exponent ? 1 : s_.times); }
  [[nodiscard]] std::size_t per_input() const { return 1 + s_.times + (s_.play ? 1 : 0); }
  [[nodiscard]] Index answer_column(std::size_t j) const {
    return static_cast<Index>(data_.size() * per_recording() + j * per_input());
  }
  [[nodiscard]] Index drift_column() const {
    return static_cast<Index>(data_.size() * per_recording() + inputs_ * per_input());
  }

  [[nodiscard]] double scale(const VectorXd& u) const { return std::max(std::fabs(begins_[0] - u[2]), 1e-9 * span_); }
  static double settled(double t_s, double time_s, double exponent) {
    const double order = exponent - 1.0;
    if (std::fabs(order) < 1e-6) return std::exp(-t_s / time_s);
    const double bracket = 1.0 + order * t_s / time_s;
    return bracket > 0.0 ? std::pow(bracket, -1.0 / order) : 0.0;
  }

  void answer(const Data& of, std::size_t j, const VectorXd& u, const std::vector<std::size_t>& rows,
              MatrixXd& out) const {
    const auto& value = of.inputs[j].value;
    const Index first = answer_column(j);
    std::vector<model::MaxwellState> units;
    for (std::size_t i = 0; i < s_.times; ++i) units.emplace_back(std::exp(u[static_cast<Index>(i)]));
    const double width = s_.play ? std::exp(u[static_cast<Index>(s_.times + j)]) : 0.0;
    std::vector<double> stretched(units.size());
    double play = 0.0;
    Index row = !rows.empty() && rows[0] == 0 ? 1 : 0;  // of the first reading all are zero
    for (std::size_t k = 1; k < value.size() && row < out.rows(); ++k) {
      const double change = value[k] - value[0];
      for (std::size_t i = 0; i < units.size(); ++i)
        stretched[i] = units[i].step(value[k] - value[k - 1], of.t_s[k] - of.t_s[k - 1]);
      play = std::clamp(play, change - width, change + width);
      if (rows[static_cast<std::size_t>(row)] != k) continue;
      out(row, first) = change;
      for (std::size_t i = 0; i < units.size(); ++i)
        out(row, first + 1 + static_cast<Index>(i)) = change - stretched[i];
      if (s_.play) out(row, first + 1 + static_cast<Index>(s_.times)) = play;
      ++row;
    }
  }

  /// An answer has one sign in all its parts: that of the plain regression of output on inputs. What settles has that
  /// of the way from the beginning to the end.
  void lay_out_signs() {
    for (const Data& each : data_) {
      if (inputs_ > 0) signs_.push_back(model::Sign::kFree);
      const double way = each.output_value.back() - each.output_value.front();
      const auto settles = way > 0.0 ? model::Sign::kNonPositive : model::Sign::kNonNegative;
      for (std::size_t i = 0; i < (s_.exponent ? 1 : s_.times); ++i)
        signs_.push_back(inputs_ > 0 ? model::Sign::kFree : settles);
    }
    for (const double slope : slopes())
      signs_.insert(signs_.end(), per_input(), slope < 0.0 ? model::Sign::kNonPositive : model::Sign::kNonNegative);
    if (s_.drift) signs_.push_back(model::Sign::kFree);
    if (inputs_ == 0 && !s_.exponent) signs_.push_back(model::Sign::kFree);
  }
  [[nodiscard]] std::vector<double> slopes() const {
    if (inputs_ == 0) return {};
    MatrixXd columns = MatrixXd::Zero(static_cast<Index>(rows_), static_cast<Index>(inputs_ + data_.size()));
    VectorXd right(static_cast<Index>(rows_));
    Index row = 0;
    for (std::size_t r = 0; r < data_.size(); ++r)
      for (std::size_t k = 0; k < data_[r].t_s.size(); ++k, ++row) {
        for (std::size_t j = 0; j < inputs_; ++j) columns(row, static_cast<Index>(j)) = data_[r].inputs[j].value[k];
        columns(row, static_cast<Index>(inputs_ + r)) = 1.0;
        right[row] = data_[r].output_value[k];
      }
    const VectorXd x = columns.colPivHouseholderQr().solve(right);
    return {x.data(), x.data() + inputs_};
  }

  const std::vector<Data>& data_;
  Structure s_;
  std::size_t inputs_;
  std::size_t rows_ = 0;
  std::vector<double> begins_;
  std::vector<std::vector<std::size_t>> all_, fitted_;
  double noise_ = 0.0, span_ = 0.0;
  VectorXd lower_, upper_;
  std::vector<model::Sign> signs_;
};

}  // namespace isorig::identify::response
