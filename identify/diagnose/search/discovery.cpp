#include "identify/diagnose/search/discovery.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/basis.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/noise/effective_dof.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Part;

constexpr std::size_t kMostProducts = 3;  // that there is room for; deciding().most_products are taken

/// The size of a dashpot's state is its speed: a law of its own in files, and the same product as `dashpot_rate`, with
/// which it would share the weight of every set.
constexpr std::string_view kTwin = "dashpot_magnitude";

/// Every product at every value of its grid.
std::vector<Part> screened_parts(const ModelSpec& base, bool has_pressure) {
  std::vector<Part> out;
  for (const model::Law& plain : model::element::discovered().laws) {
    if (plain.name == kTwin || (!has_pressure && plain.name.ends_with("_pressure"))) continue;
    const model::Law& law = model::law_at(plain, base.length_scale);
    Part part = model::make_part(model::element::discovered(), law);
    if (law.parameters.empty()) {
      out.push_back(part);
      continue;
    }
    std::vector<double> grid = law.parameters[0].starts;
    if (plain.name.starts_with("arm_"))
      for (const Part& other : base.parts)
        if (other.physics == &model::element::maxwell()) grid.push_back(other.parameters[0]);
    for (const double value : grid) {
      part.parameters[0] = value;
      out.push_back(part);
    }
  }
  return out;
}

/// What a small change of each free parameter does to the force. Its column keeps products from gaining by what another
/// time constant would do as well.
RowMatrix changes_by_parameters(const Problem& problem, const ModelSpec& base) {
  constexpr double kStep = 0.01;
  const Eigen::VectorXd at_rest = problem.predict(base);
  std::vector<Eigen::VectorXd> changes;
  for (std::size_t p = 0; p < base.parts.size(); ++p) {
    if (model::is_empirical(*base.parts[p].physics)) continue;
    for (std::size_t i = 0; i < base.parts[p].parameters.size(); ++i) {
      const model::Parameter& parameter = base.parts[p].law->parameters[i];
      if (parameter.fixed || parameter.traits.event_time) continue;
      ModelSpec moved = base;
      double& value = moved.parts[p].parameters[i];
      const double towards = parameter.upper - value > value - parameter.lower ? 1.0 : -1.0;
      value += towards * kStep * (parameter.logarithmic ? value : parameter.upper - parameter.lower);
      changes.emplace_back(problem.predict(moved) - at_rest);
    }
  }
  RowMatrix out(at_rest.size(), static_cast<Eigen::Index>(changes.size()));
  for (std::size_t i = 0; i < changes.size(); ++i) out.col(static_cast<Eigen::Index>(i)) = changes[i];
  return out;
}

using Set = std::vector<std::size_t>;

/// Products of one column each, freed of the model's own.
struct Screen {
  std::vector<Part> parts;
  Eigen::MatrixXd columns;  ///< of length one
  Eigen::VectorXd residual;
  Eigen::MatrixXd gram;
  Eigen::VectorXd right;
  double squares = 0.0;

  [[nodiscard]] Eigen::VectorXd coefficients(const Set& set) const { return gram(set, set).ldlt().solve(right(set)); }
  /// Of the residual's squares; 0 for a set whose products can hardly be told apart.
  [[nodiscard]] double explained(const Set& set) const {
    const Eigen::LDLT<Eigen::MatrixXd> solver(gram(set, set));
    if (solver.vectorD().minCoeff() < deciding().product_pivot) return 0.0;
    return std::clamp(right(set).dot(solver.solve(right(set))) / squares, 0.0, 1.0 - 1e-12);
  }
};

Screen screen(const Problem& problem, const ModelSpec& base) {
  const auto series = problem.series();
  const bool has_pressure =
      std::ranges::any_of(series, [](const Series& s) { return !s.excitation.pressure_psi.empty(); });
  std::vector<Part> parts = screened_parts(base, has_pressure);
  Eigen::VectorXd weight(problem.target().size());
  Eigen::Index row = 0;
  for (const Series& each : series)
    for (const double count : each.count) weight[row++] = std::sqrt(count);

  ModelSpec all = base;
  all.parts.insert(all.parts.end(), parts.begin(), parts.end());
  RowMatrix columns;
  problem.columns(all, columns);
  const auto own = static_cast<Eigen::Index>(base.coefficient_count());
  const RowMatrix changes = changes_by_parameters(problem, base);
  Eigen::MatrixXd taken(columns.rows(), own + changes.cols());
  taken << columns.leftCols(own), changes;
  const Eigen::MatrixXd q = orthonormal_basis(weight.asDiagonal() * taken);

  Screen out;
  out.residual = weight.cwiseProduct(problem.target() - problem.predict(base));
  out.residual -= q * (q.transpose() * out.residual);
  out.columns.resize(columns.rows(), static_cast<Eigen::Index>(parts.size()));
  Eigen::Index used = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    Eigen::VectorXd column = weight.cwiseProduct(columns.col(own + static_cast<Eigen::Index>(i)));
    const double length = column.norm();
    column -= q * (q.transpose() * column);
    if (!(column.norm() > deciding().product_own_share * length)) continue;
    out.columns.col(used++) = column.normalized();
    out.parts.push_back(std::move(parts[i]));
  }
  out.columns.conservativeResize(Eigen::NoChange, used);
  out.gram = out.columns.transpose() * out.columns;
  out.right = out.columns.transpose() * out.residual;
  out.squares = out.residual.squaredNorm();
  return out;
}

/// Calls `with` for every set of `size` products, no law twice.
template <class With>
void every_set(const Screen& screened, std::size_t size, Set& set, const With& with) {
  if (set.size() == size) {
    with(set);
    return;
  }
  for (std::size_t i = set.empty() ? 0 : set.back() + 1; i < screened.parts.size(); ++i) {
    const bool has_law =
        std::ranges::any_of(set, [&](std::size_t j) { return screened.parts[j].law == screened.parts[i].law; });
    if (has_law) continue;
    set.push_back(i);
    every_set(screened, size, set, with);
    set.pop_back();
  }
}

struct Weighed {
  std::array<Set, kMostProducts + 1> best;  ///< by size
  std::map<std::string, double> inclusion;
  double nothing = 1.0;  ///< weight of no product at all
};

Weighed weigh(const Screen& screened, std::span<const Series> series) {
  Weighed out;
  struct One {
    Set set;
    double explained = 0.0;
  };
  std::vector<One> sets;
  std::array<double, kMostProducts + 1> number{1.0}, most{};
  for (std::size_t size = 1; size <= deciding().most_products; ++size) {
    Set set;
    every_set(screened, size, set, [&](const Set& one) {
      const double explained = screened.explained(one);
      sets.push_back({one, explained});
      number[size] += 1.0;
      if (explained > most[size]) {
        most[size] = explained;
        out.best[size] = one;
      }
    });
  }
  const Set& largest = out.best[deciding().most_products].empty() ? out.best[1] : out.best[deciding().most_products];
  if (largest.empty()) return out;
  Eigen::VectorXd left = screened.residual - screened.columns(Eigen::all, largest) * screened.coefficients(largest);
  const double n = std::max(effective_degrees_of_freedom(series, left), 2.0 * kMostProducts + 2.0);
  const auto log_weight = [&](std::size_t size, double explained) {
    const auto k = static_cast<double>(size);
    return 0.5 * (n - 1.0 - k) * std::log1p(n) - 0.5 * (n - 1.0) * std::log1p(n * (1.0 - explained)) -
           std::log(number[size]);
  };
  const double none = log_weight(0, 0.0);
  double highest = none;
  for (const One& one : sets) highest = std::max(highest, log_weight(one.set.size(), one.explained));
  double total = std::exp(none - highest);
  for (const One& one : sets) {
    const double weight = std::exp(log_weight(one.set.size(), one.explained) - highest);
    total += weight;
    for (const std::size_t i : one.set) out.inclusion[std::string(screened.parts[i].law->name)] += weight;
  }
  for (auto& [law, weight] : out.inclusion) weight /= total;
  out.nothing = std::exp(none - highest) / total;
  return out;
}

}  // namespace

std::vector<DiscoveredModel> discover(const Problem& problem, const ModelSpec& base) {
  std::vector<DiscoveredModel> out;
  const Screen screened = screen(problem, base);
  if (!(screened.squares > 0.0) || screened.parts.empty()) return out;
  const Weighed weighed = weigh(screened, problem.series());
  if (weighed.nothing > deciding().nothing_probability) return out;
  for (std::size_t size = 1; size <= deciding().most_products; ++size) {
    if (weighed.best[size].empty()) continue;
    DiscoveredModel one{base, weighed.inclusion, {}};
    for (const std::size_t i : weighed.best[size]) {
      one.spec.parts.push_back(screened.parts[i]);
      one.laws.push_back(screened.parts[i].law->name);
    }
    one.spec = problem.fit(one.spec, 30).spec;
    out.push_back(std::move(one));
  }
  return out;
}

}  // namespace isorig::identify
