#include "identify/diagnose/search/empirical.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "identify/diagnose/search/physical_size.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/one_recording.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Table;

constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();

struct Covariate {
  std::string_view law;
  std::size_t knots;
  std::vector<double> value;  ///< NaN: the table does not act here
};

std::vector<Covariate> covariates(std::span<const Series> series) {
  std::vector<Covariate> all{
      {"position", 260, {}}, {"rate", 24, {}}, {"travel", 40, {}}, {"extending", 40, {}}, {"shortening", 40, {}}};
  const bool pressure = std::ranges::any_of(series, [](const Series& s) { return !s.excitation.pressure_psi.empty(); });
  if (pressure) all.push_back({"pressure", 24, {}});
  for (const Series& each : series) {
    double travelled = 0.0, direction = 0.0;
    for (const auto& node : each.nodes) {
      travelled += std::fabs(node.step_mm);
      if (node.slide_mm != 0.0) direction = node.slide_mm;
      for (Covariate& c : all) {
        if (c.law == "position")
          c.value.push_back(node.position_mm);
        else if (c.law == "rate")
          c.value.push_back(std::asinh(node.velocity_mm_s / 0.01));
        else if (c.law == "travel")
          c.value.push_back(travelled);
        else if (c.law == "pressure")
          c.value.push_back(node.excess_pressure_psi);
        else if (c.law == "extending")
          c.value.push_back(direction > 0.0 ? node.position_mm : kNowhere);
        else
          c.value.push_back(direction < 0.0 ? node.position_mm : kNowhere);
      }
    }
  }
  return all;
}

struct TableFit {
  Table table;
  double gain = 0.0;     ///< cross-validated: whitened squares saved on what was left out
  double freedom = 0.0;  ///< effective number of parameters
};

/// Table v (a B-spline of degree one, by its values at the knots) beside the model's own columns with coefficients a,
/// by penalised least squares (Eilers & Marx 1996):
///
///     min sum_i w_i (r_i - (B v)_i - (C a)_i)^2 + lambda h |D v|^2
///
/// r is the residual, B interpolates between knots, D takes second differences, h is the mean weight of a knot. With
/// G_f and g_f the normal matrix and right side of fold f, and c fitted to the other folds, the squares that the table
/// saves on f are 2 c'g_f - c'G_f c; lambda is the value that saves most over all folds.
TableFit fit_table(const Covariate& covariate, const RowMatrix& columns, const Eigen::VectorXd& residual,
                   const Eigen::VectorXd& weight, const std::vector<int>& fold, int folds) {
  TableFit out;
  double low = 1e300, high = -1e300;
  for (const double v : covariate.value) {
    if (std::isnan(v)) continue;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  if (!(high > low)) return out;
  const auto k = static_cast<Eigen::Index>(covariate.knots);
  const Eigen::Index m = columns.cols(), width = k + m;
  out.table.first = low;
  out.table.step = (high - low) / static_cast<double>(k - 1);
  std::vector<Eigen::MatrixXd> gram(static_cast<std::size_t>(folds), Eigen::MatrixXd::Zero(width, width));
  std::vector<Eigen::VectorXd> right(gram.size(), Eigen::VectorXd::Zero(width));
  std::vector<double> total(gram.size(), 0.0);
  std::vector<Eigen::Index> where(static_cast<std::size_t>(2 + m));
  std::vector<double> what(where.size());
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const auto f = static_cast<std::size_t>(fold[i]);
    const double v = covariate.value[i], w = weight[i];
    Eigen::Index used = 0;
    if (!std::isnan(v)) {
      const double u = std::clamp((v - low) / out.table.step, 0.0, static_cast<double>(k - 1) - 1e-9);
      const auto at = static_cast<Eigen::Index>(u);
      where[0] = at;
      what[0] = 1.0 - (u - static_cast<double>(at));
      where[1] = at + 1;
      what[1] = u - static_cast<double>(at);
      used = 2;
    }
    for (Eigen::Index c = 0; c < m; ++c) {
      where[used] = k + c;
      what[used++] = columns(i, c);
    }
    for (Eigen::Index a = 0; a < used; ++a) {
      right[f][where[a]] += w * what[a] * residual[i];
      for (Eigen::Index b = 0; b < used; ++b) gram[f](where[a], where[b]) += w * what[a] * what[b];
    }
    total[f] += w * residual[i] * residual[i];
  }
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(width, width);
  Eigen::VectorXd all_right = Eigen::VectorXd::Zero(width);
  for (std::size_t f = 0; f < gram.size(); ++f) {
    all += gram[f];
    all_right += right[f];
  }
  const double typical = std::max(all.diagonal().head(k).mean(), 1e-300);
  Eigen::MatrixXd bend = Eigen::MatrixXd::Zero(width, width);
  for (Eigen::Index i = 0; i + 2 < k; ++i) {
    const std::array<double, 3> d{1.0, -2.0, 1.0};
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) bend(i + a, i + b) += d[a] * d[b];
  }
  Eigen::MatrixXd ridge = Eigen::MatrixXd::Zero(width, width);
  ridge.diagonal().head(k).setConstant(1e-6 * typical);
  for (Eigen::Index c = 0; c < m; ++c) ridge(k + c, k + c) = 1e-9 * std::max(all(k + c, k + c), 1e-300);
  double best_lambda = -1.0;
  for (const double lambda : {0.01, 0.3, 10.0, 300.0, 1e4, 1e6}) {
    double saved = 0.0;
    for (std::size_t f = 0; f < gram.size(); ++f) {
      const Eigen::MatrixXd a = all - gram[f] + lambda * typical * bend + ridge;
      const Eigen::VectorXd c = a.ldlt().solve(all_right - right[f]);
      saved += 2.0 * c.dot(right[f]) - c.dot(gram[f] * c);
    }
    if (saved > out.gain) {
      out.gain = saved;
      best_lambda = lambda;
    }
  }
  if (best_lambda < 0.0) return out;
  const Eigen::MatrixXd a = all + best_lambda * typical * bend + ridge;
  const auto solver = a.ldlt();
  const Eigen::VectorXd c = solver.solve(all_right);
  out.freedom = solver.solve(all).trace() - static_cast<double>(m);
  out.table.values.assign(c.data(), c.data() + k);
  return out;
}

/// A part that holds the table.
model::Part table_part(const model::Physics& physics, std::string_view law_name, Table table) {
  const model::Law* law = model::find_law(physics, law_name);
  model::Part part = model::make_part(physics, *law);
  part.table = std::move(table);
  part.fixed = true;
  if (!part.coefficients.empty()) part.coefficients[0] = 1.0;
  return part;
}

/// Whole stiffness of the model: what turns a force into an error of the position.
double stiffness_of(const ModelSpec& spec) {
  double stiffness = 0.0;
  for (const auto& part : spec.parts)
    if (part.physics == &model::element::spring()) stiffness += part.coefficients[0];
  return stiffness;
}

/// What tables are fitted to: weights, the folds of the cross-validation and the variables.
class Tabulator {
 public:
  explicit Tabulator(const Problem& problem) : problem_(problem), covariates_(covariates(problem.series())) {
    const NoiseModel& noise = problem.noise();
    weight_.resize(problem.target().size());
    // Moves, not strokes: strokes that repeat one motion let any table predict them.
    const MoveNumbers moves = number_moves(problem.series());
    Eigen::Index row = 0;
    for (const Series& each : problem.series()) {
      for (const double count : each.count) {
        weight_[row] =
            count > 0.0 ? 1.0 / (noise.white_N * noise.white_N / count + noise.coloured_N * noise.coloured_N) : 0.0;
        fold_.push_back(static_cast<int>(moves.of_bin[static_cast<std::size_t>(row)] % kFolds));
        ++row;
      }
    }
  }

  [[nodiscard]] const std::vector<Covariate>& variables() const noexcept { return covariates_; }
  [[nodiscard]] double squares(const ModelSpec& spec) const {
    const Eigen::VectorXd r = problem_.target() - problem_.predict(spec);
    return (r.array().square() * weight_.array()).sum();
  }

  /// Table of one variable beside the columns of the model that are free.
  [[nodiscard]] TableFit fit(const Covariate& covariate, const ModelSpec& spec) const {
    RowMatrix all;
    problem_.columns(spec, all);
    // The table's own column must not be fitted against it.
    std::vector<Eigen::Index> own;
    Eigen::Index at = 0;
    for (const auto& part : spec.parts)
      for (std::size_t i = 0; i < part.coefficients.size(); ++i, ++at)
        if (!part.fixed) own.push_back(at);
    RowMatrix free(all.rows(), static_cast<Eigen::Index>(own.size()));
    for (std::size_t i = 0; i < own.size(); ++i) free.col(static_cast<Eigen::Index>(i)) = all.col(own[i]);
    return fit_table(covariate, free, problem_.target() - problem_.predict(spec), weight_, fold_, kFolds);
  }

  /// In turn: the model with the table (the last part) held, the table with the model held. A table of what passed in
  /// one recording leaves the model as it is: numbers that are fitted beside it would be worth nothing without it, and
  /// any other recording is predicted without it.
  [[nodiscard]] std::pair<ModelSpec, double> improve(ModelSpec spec, const Covariate& covariate, bool motion,
                                                     int rounds) const {
    if (model::of_one_recording(spec.parts.back())) return {spec, squares(spec)};
    ModelSpec kept = spec;
    double kept_squares = squares(problem_.fit(spec, 15).spec);
    for (int round = 0; round < rounds; ++round) {
      spec = problem_.fit(spec, 12).spec;
      const double now = squares(spec);
      if (now > kept_squares * 1.0001 && round > 0) break;
      kept = spec;
      kept_squares = now;
      const double stiffness = stiffness_of(spec);
      const TableFit more = fit(covariate, spec);
      if (more.table.values.empty()) break;
      auto& table = spec.parts.back().table;
      for (std::size_t i = 0; i < table.values.size(); ++i)
        table.values[i] += motion ? (stiffness > 0.0 ? more.table.values[i] / stiffness : 0.0) : more.table.values[i];
    }
    return {kept, kept_squares};
  }

 private:
  static constexpr int kFolds = 6;
  const Problem& problem_;
  std::vector<Covariate> covariates_;
  Eigen::VectorXd weight_;
  std::vector<int> fold_;
};

}  // namespace

bool has_table(const ModelSpec& spec) {
  return std::ranges::any_of(spec.parts, [](const model::Part& part) { return part.law->make_table != nullptr; });
}

std::optional<Hypothesis> describe_unknown(const Search& search, const Hypothesis& base) {
  constexpr int kRounds = 4;
  const Problem& problem = search.instrument_problem();
  const Tabulator tabulator(problem);
  const auto& all = tabulator.variables();
  Hypothesis out = base;
  const double before = tabulator.squares(base.fit.spec);
  std::vector<TableFit> fits(all.size());
  for (std::size_t c = 0; c < all.size(); ++c) {
    fits[c] = tabulator.fit(all[c], base.fit.spec);
    if (all[c].law == "pressure" && beyond_physical_size(fits[c].table, problem.series())) fits[c].gain = 0.0;
  }
  std::size_t best = 0;
  for (std::size_t c = 1; c < all.size(); ++c)
    if (fits[c].gain > fits[best].gain) best = c;
  if (fits[best].gain < std::max(deciding().table_least_squares, deciding().table_least_share * before))
    return std::nullopt;

  ModelSpec spec = base.fit.spec;
  spec.parts.push_back(table_part(model::element::empirical_force(), all[best].law, fits[best].table));
  auto [chosen, chosen_squares] = tabulator.improve(spec, all[best], false, kRounds);
  out.empirical = all[best].law;
  if (const double stiffness = stiffness_of(base.fit.spec); all[best].law == "position" && stiffness > 0.0) {
    ModelSpec moved = base.fit.spec;
    Table table = fits[best].table;
    for (double& v : table.values) v /= stiffness;
    moved.parts.push_back(table_part(model::element::empirical_motion(), "position", std::move(table)));
    auto [motion, motion_squares] = tabulator.improve(moved, all[best], true, kRounds);
    if (motion_squares < chosen_squares) {
      chosen = motion;
      chosen_squares = motion_squares;
      out.empirical = "position (as an error of the position)";
    }
  }
  out.fit.spec = chosen;
  out.fit.rows = base.fit.rows;
  Eigen::VectorXd ignored;
  out.fit.chi2 = problem.solve(chosen, ignored);
  out.ls_chi2 = out.fit.chi2;
  const NoiseModel left = problem.estimate_noise(out.fit.spec);
  out.fit.noise = left;
  out.fit.log_likelihood = problem.log_likelihood(out.fit.spec, left);
  const double cost = deciding().numbers_cost_log_rows * std::log(static_cast<double>(base.fit.rows));
  out.evidence =
      out.fit.log_likelihood - cost * (fits[best].freedom + 2.0 * static_cast<double>(base.effects.size() + 3));
  return out;
}

model::ModelSpec learn_table_again(const Problem& problem, ModelSpec spec) {
  constexpr int kRounds = 2;
  const model::Part old = spec.parts.back();
  spec.parts.pop_back();
  spec = problem.fit(std::move(spec), 12).spec;
  const bool motion = old.physics == &model::element::empirical_motion();
  const Tabulator tabulator(problem);
  const auto of = std::ranges::find(tabulator.variables(), old.law->name, &Covariate::law);
  if (of != tabulator.variables().end()) {
    Table table = tabulator.fit(*of, spec).table;
    const double stiffness = stiffness_of(spec);
    if (motion)
      for (double& v : table.values) v = stiffness > 0.0 ? v / stiffness : 0.0;
    if (!table.values.empty()) {
      spec.parts.push_back(table_part(*old.physics, old.law->name, std::move(table)));
      return tabulator.improve(std::move(spec), *of, motion, kRounds).first;
    }
  }
  // No table predicts the left-out blocks better than none: a table of zeros.
  spec.parts.push_back(old);
  for (double& v : spec.parts.back().table.values) v = 0.0;
  return spec;
}

bool tabulates_one_recording(const ModelSpec& spec) {
  return has_table(spec) && model::of_one_recording(spec.parts.back());
}

ModelSpec with_table_like(const Problem& problem, ModelSpec base, const model::Part& like) {
  const Tabulator tabulator(problem);
  const auto of = std::ranges::find(tabulator.variables(), like.law->name, &Covariate::law);
  if (of == tabulator.variables().end()) return base;
  Table table = tabulator.fit(*of, base).table;
  if (!table.values.empty()) base.parts.push_back(table_part(*like.physics, like.law->name, std::move(table)));
  return base;
}

}  // namespace isorig::identify
