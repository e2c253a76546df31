#include "identify/response/response_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "base/quantile.hpp"
#include "identify/diagnose/fit/nonlinear_least_squares.hpp"
#include "identify/diagnose/fit/signed_least_squares.hpp"
#include "identify/diagnose/signal/noise_level.hpp"
#include "model/stepping.hpp"

namespace isorig::identify::response {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kHour_s = 3600.0;
/// Of a recording that a search sees; the residual is that of all.
constexpr std::size_t kMostRows = 5000;

double span_of(const std::vector<double>& values) {
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
      noise_ = std::max(noise_, white_noise(each.t_s, each.output_value));
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
    const VectorXd x = solve_signed(reduce_columns(all, right), signs_);
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
    for (std::size_t r = 0; r < data_.size(); ++r)
      sum += x.segment(static_cast<Index>(r * per_recording()), static_cast<Index>(s_.times));
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

struct Found {
  VectorXd u;
  double squares = 1e300;
  bool at_bound = false;
};

Found search_from(const Separable& problem, VectorXd u) {
  constexpr int kIterations = 60;
  LeastSquaresProblem p;
  p.residual = [&](const VectorXd& at, VectorXd& residual) { static_cast<void>(problem.solve(at, &residual)); };
  p.difference_steps = [&](const VectorXd& at) {
    VectorXd steps = VectorXd::Constant(at.size(), 1e-5);
    for (Index i = 0; i < at.size(); ++i) {
      steps[i] *= std::max(1.0, std::fabs(at[i]));
      if (at[i] + steps[i] > problem.upper()[i]) steps[i] = -steps[i];
    }
    return steps;
  };
  p.lower = problem.lower();
  p.upper = problem.upper();
  p.longest_step = 0.25 * (p.upper - p.lower);
  const LeastSquaresResult result = minimise_squares(p, std::move(u), kIterations);
  return {result.u, result.squares, result.stop == Stop::kAtBounds};
}

/// Times begin at every point of a logarithmic grid beside those of the fit with one time fewer, `from`; the two best
/// go on. From a fit of the same structure the search goes on alone.
Found search(const Separable& problem, const std::vector<Data>& data, const Structure& structure,
             const VectorXd& from) {
  constexpr int kGrid = 12;
  constexpr std::size_t kGoOn = 2;
  if (from.size() == problem.nonlinear()) return search_from(problem, from);
  std::vector<VectorXd> starts;
  VectorXd u = 0.5 * (problem.lower() + problem.upper());
  const auto times = static_cast<Index>(structure.times);
  for (std::size_t j = 0; structure.play && j < data[0].inputs.size(); ++j) {
    const Index at = times + static_cast<Index>(j);
    u[at] = 0.8 * problem.upper()[at] + 0.2 * problem.lower()[at];
  }
  if (from.size() == problem.nonlinear() - 1 && times > 1) {
    u.head(times - 1) = from.head(times - 1);
    u.tail(u.size() - times) = from.tail(from.size() - (times - 1));
  }
  for (int g = 0; g < kGrid; ++g) {
    const double share = (static_cast<double>(g) + 0.5) / kGrid;
    u[times - 1] = problem.lower()[times - 1] + share * (problem.upper()[times - 1] - problem.lower()[times - 1]);
    starts.push_back(u);
    if (structure.exponent) {
      starts.back()[1] = 1.3;
      starts.back()[2] = data[0].output_value.back();
      starts.push_back(starts.back());
      starts.back()[1] = 0.7;
    }
  }
  std::vector<std::pair<double, std::size_t>> ranked;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    VectorXd residual;
    static_cast<void>(problem.solve(starts[i], &residual));
    if (const double squares = residual.squaredNorm(); std::isfinite(squares)) ranked.emplace_back(squares, i);
  }
  std::ranges::sort(ranked);
  Found best;
  for (std::size_t k = 0; k < std::min(kGoOn, ranked.size()); ++k)
    if (Found found = search_from(problem, starts[ranked[k].second]); found.squares < best.squares)
      best = std::move(found);
  if (best.u.size() == 0)
    throw std::domain_error(
        "the answer of the models does not come out in finite numbers for any start; look at the "
        "recordings for values that cannot be meant");
  return best;
}

std::string number_name(std::string_view what, std::string_view output, std::string_view column) {
  const auto at = column.rfind('_');
  return std::string(what) + '_' + std::string(output) + "_per_" + std::string(column.substr(at + 1));
}

/// The problem about a fit: slopes of all numbers, nonlinear ones first, at the rows that the search saw.
struct Linearised {
  MatrixXd jacobian;
  VectorXd residual;
};
Linearised linearise(const Separable& problem, std::size_t recordings, const VectorXd& u, const VectorXd& x) {
  Index rows = 0;
  for (std::size_t r = 0; r < recordings; ++r) rows += static_cast<Index>(problem.rows(r, false).size());
  const Index n = u.size(), m = x.size();
  Linearised out{MatrixXd(rows, n + m), VectorXd(rows)};
  Index at = 0;
  for (std::size_t r = 0; r < recordings; ++r) {
    const MatrixXd columns = problem.columns(r, u, false);
    const VectorXd here = problem.target(r, u, false) - columns * x;
    out.residual.segment(at, here.size()) = here;
    out.jacobian.block(at, n, columns.rows(), m) = columns;
    for (Index i = 0; i < n; ++i) {
      VectorXd moved = u;
      const double step = 1e-5 * std::max(1.0, std::fabs(u[i]));
      moved[i] += step;
      out.jacobian.block(at, i, columns.rows(), 1) =
          (here - (problem.target(r, moved, false) - problem.columns(r, moved, false) * x)) / step;
    }
    at += columns.rows();
  }
  return out;
}

/// Half-widths of the 95 % intervals of all numbers (Gauss-Newton), widened by the residual's autocorrelation; infinite
/// for what is not determined.
VectorXd half_widths(const Linearised& at, double rows_of_all, double inflation) {
  MatrixXd jacobian = at.jacobian;
  const Index rows = jacobian.rows(), numbers = jacobian.cols();
  // The rows that the search saw have fewer readings between independent ones than all rows have.
  const double thinned = static_cast<double>(rows) / std::max(1.0, rows_of_all);
  const double variance = at.residual.squaredNorm() / std::max<double>(1.0, static_cast<double>(rows - numbers)) *
                          std::max(1.0, inflation * thinned);
  // Columns of one length, so that units do not decide which number counts as undetermined.
  VectorXd length(numbers);
  for (Index i = 0; i < numbers; ++i) {
    length[i] = jacobian.col(i).norm();
    if (length[i] > 0.0) jacobian.col(i) /= length[i];
  }
  Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(jacobian.transpose() * jacobian);
  constexpr double kDetermined = 1e-10, kTwoSided95 = 1.96;
  const auto variance_of = [&](Index i) {
    double sum = 0.0;
    for (Index e = 0; e < numbers; ++e) {
      const double share = eigen.eigenvectors()(i, e) * eigen.eigenvectors()(i, e);
      if (eigen.eigenvalues()[e] > kDetermined)
        sum += share / eigen.eigenvalues()[e];
      else if (share > 1e-6)
        return std::numeric_limits<double>::infinity();
    }
    return length[i] > 0.0 ? variance * sum / (length[i] * length[i]) : std::numeric_limits<double>::infinity();
  };
  VectorXd out(numbers);
  for (Index i = 0; i < numbers; ++i) out[i] = kTwoSided95 * std::sqrt(variance_of(i));
  return out;
}

/// Names, values and intervals in the order of the model's file.
void name_numbers(const std::vector<Data>& data, const VectorXd& u, const VectorXd& x, const VectorXd& half_width,
                  ResponseFit& fit) {
  const Index n = u.size(), m = x.size();
  const auto add = [&](std::string name, double value, double by) {
    fit.numbers.push_back({std::move(name), value, value - by, value + by});
  };
  const auto add_log = [&](std::string name, Index i) {
    const double value = std::exp(u[i]), factor = std::exp(half_width[i]);
    fit.numbers.push_back({std::move(name), value, value / factor, value * factor});
  };
  const std::string_view unit = unit_of(data[0].output);
  std::vector<Index> order(fit.structure.times);
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::sort(order, {}, [&](Index i) { return u[i]; });
  for (std::size_t i = 0; i < order.size(); ++i) add_log("time_" + std::to_string(i + 1) + "_s", order[i]);
  const std::size_t inputs = data[0].inputs.size();
  const Index first = m - static_cast<Index>(inputs * (1 + fit.structure.times + (fit.structure.play ? 1 : 0))) -
                      (fit.structure.drift ? 1 : 0) - (inputs == 0 && !fit.structure.exponent ? 1 : 0);
  Index column = first;
  for (std::size_t j = 0; j < inputs; ++j) {
    const auto name = data[0].inputs[j].column;
    add(number_name("immediate", unit, name), x[column], half_width[n + column]);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const Index c = column + 1 + order[i];
      add(number_name("retarded_" + std::to_string(i + 1), unit, name), x[c], half_width[n + c]);
    }
    column += 1 + static_cast<Index>(order.size());
    if (fit.structure.play) {
      add_log("play_width_" + std::string(name.substr(name.rfind('_') + 1)),
              static_cast<Index>(fit.structure.times + j));
      add(number_name("play_gain", unit, name), x[column], half_width[n + column]);
      ++column;
    }
  }
  if (fit.structure.drift) {
    add("drift_" + std::string(unit) + "_per_h", x[column], half_width[n + column]);
    ++column;
  }
  if (fit.structure.exponent) {
    add("exponent", u[1], half_width[1]);
    add("rest_" + std::string(unit), u[2], half_width[2]);
  } else if (inputs == 0) {
    add("rest_" + std::string(unit), x[m - 1], half_width[n + m - 1]);
  }
}

}  // namespace

double independent_rows(const std::vector<VectorXd>& residual) {
  double lagged = 0.0, squares = 0.0, rows = 0.0;
  for (const VectorXd& r : residual) {
    for (Index k = 1; k < r.size(); ++k) lagged += r[k] * r[k - 1];
    squares += r.squaredNorm();
    rows += static_cast<double>(r.size());
  }
  const double rho = squares > 0.0 ? std::clamp(lagged / squares, 0.0, 0.9999) : 0.0;
  return std::max(1.0, rows * (1.0 - rho) / (1.0 + rho));
}

ResponseFit fit_response(const std::vector<Data>& data, const Structure& structure,
                         const std::vector<std::vector<bool>>& used, const ResponseFit* from) {
  const Separable problem(data, structure, used);
  VectorXd start;
  if (from != nullptr) {
    start = from->nonlinear;
  } else if (structure.times > 1) {
    Structure fewer = structure;
    --fewer.times;
    start = fit_response(data, fewer, used, nullptr).nonlinear;
  }
  const Found found = search(problem, data, structure, start);
  ResponseFit fit;
  fit.structure = structure;
  fit.at_bound = found.at_bound;
  fit.nonlinear = found.u;
  const VectorXd x = problem.solve(found.u, nullptr);
  fit.model = problem.model(found.u, x);
  double squares = 0.0, rows = 0.0;
  for (std::size_t r = 0; r < data.size(); ++r) {
    fit.residual.push_back(problem.target(r, found.u, true) - problem.columns(r, found.u, true) * x);
    for (Index k = 0; k < fit.residual.back().size(); ++k) {
      if (!used.empty() && !used[r][static_cast<std::size_t>(k)]) continue;
      squares += fit.residual.back()[k] * fit.residual.back()[k];
      rows += 1.0;
    }
  }
  fit.rms = std::sqrt(squares / std::max(1.0, rows));
  if (used.empty()) {
    double rows_of_all = 0.0;
    for (const Data& each : data) rows_of_all += static_cast<double>(each.t_s.size());
    const VectorXd half_width =
        half_widths(linearise(problem, data.size(), found.u, x), rows_of_all, rows / independent_rows(fit.residual));
    name_numbers(data, found.u, x, half_width, fit);
  }
  return fit;
}

}  // namespace isorig::identify::response
