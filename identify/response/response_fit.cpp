#include "identify/response/response_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "identify/diagnose/fit/nonlinear_least_squares.hpp"
#include "identify/response/separable.hpp"

namespace isorig::identify::response {
namespace {

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
  const auto add = [&](std::string name, double value, double by, std::string of = {}) {
    fit.numbers.push_back({std::move(name), value, value - by, value + by, std::move(of)});
  };
  const auto add_log = [&](std::string name, Index i, std::string of) {
    const double value = std::exp(u[i]), factor = std::exp(half_width[i]);
    fit.numbers.push_back({std::move(name), value, value / factor, value * factor, std::move(of)});
  };
  const std::string_view unit = unit_of(data[0].output);
  std::vector<Index> order(fit.structure.times);
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::sort(order, {}, [&](Index i) { return u[i]; });
  for (std::size_t i = 0; i < order.size(); ++i) add_log("time_" + std::to_string(i + 1) + "_s", order[i], "s");
  const std::size_t inputs = data[0].inputs.size();
  const Index first = m - static_cast<Index>(inputs * (1 + fit.structure.times + (fit.structure.play ? 1 : 0))) -
                      (fit.structure.drift ? 1 : 0) - (inputs == 0 && !fit.structure.exponent ? 1 : 0);
  Index column = first;
  for (std::size_t j = 0; j < inputs; ++j) {
    const auto name = data[0].inputs[j].column;
    const std::string input_unit(name.substr(name.rfind('_') + 1)), ratio = std::string(unit) + "/" + input_unit;
    add(number_name("immediate", unit, name), x[column], half_width[n + column], ratio);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const Index c = column + 1 + order[i];
      add(number_name("retarded_" + std::to_string(i + 1), unit, name), x[c], half_width[n + c], ratio);
    }
    column += 1 + static_cast<Index>(order.size());
    if (fit.structure.play) {
      add_log("play_width_" + input_unit, static_cast<Index>(fit.structure.times + j), input_unit);
      add(number_name("play_gain", unit, name), x[column], half_width[n + column], ratio);
      ++column;
    }
  }
  if (fit.structure.drift) {
    add("drift_" + std::string(unit) + "_per_h", x[column], half_width[n + column], std::string(unit) + "/h");
    ++column;
  }
  if (fit.structure.exponent) {
    add("exponent", u[1], half_width[1]);
    add("rest_" + std::string(unit), u[2], half_width[2], std::string(unit));
  } else if (inputs == 0) {
    add("rest_" + std::string(unit), x[m - 1], half_width[n + m - 1], std::string(unit));
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
