#include "proof/baselines/baseline.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "base/quantile.hpp"
#include "proof/baselines/library.hpp"
#include "proof/generator/effects.hpp"
#include "proof/generator/random.hpp"

namespace isorig::proof {
namespace {

constexpr std::array<std::string_view, 5> kMethods{"chance", "greedy BIC", "CV minimum", "sparse", "black box"};
constexpr int kBlocks = 10;

/// Normal equations of all columns, in blocks of time for cross-validation.
struct Normal {
  std::vector<Eigen::MatrixXd> gram;  ///< per block, then the sum
  std::vector<Eigen::VectorXd> moment;
  std::vector<double> power;
  double rows = 0.0;

  Normal(const Eigen::MatrixXd& columns, const Eigen::VectorXd& target) : rows(static_cast<double>(target.size())) {
    const Eigen::Index n = target.size();
    for (int b = 0; b < kBlocks; ++b) {
      const Eigen::Index first = n * b / kBlocks, count = n * (b + 1) / kBlocks - first;
      const auto block = columns.middleRows(first, count);
      gram.emplace_back(block.transpose() * block);
      moment.emplace_back(block.transpose() * target.segment(first, count));
      power.push_back(target.segment(first, count).squaredNorm());
    }
    Eigen::MatrixXd all_gram = gram[0];
    Eigen::VectorXd all_moment = moment[0];
    double all_power = power[0];
    for (std::size_t b = 1; b < kBlocks; ++b) {
      all_gram += gram[b];
      all_moment += moment[b];
      all_power += power[b];
    }
    gram.push_back(std::move(all_gram));
    moment.push_back(std::move(all_moment));
    power.push_back(all_power);
  }
};

Eigen::VectorXd solved(const Eigen::MatrixXd& gram, const Eigen::VectorXd& moment, double ridge) {
  const Eigen::VectorXd scale = gram.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = scale.asDiagonal() * gram * scale.asDiagonal();
  scaled.diagonal().array() += ridge;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * moment);
}

constexpr double kRidge = 1e-10;

double squares(const Normal& normal, std::size_t block, const std::vector<int>& columns, const Eigen::VectorXd& x) {
  return normal.power[block] - 2.0 * x.dot(normal.moment[block](columns)) +
         x.dot(normal.gram[block](columns, columns) * x);
}

double total_squares(const Normal& normal, const std::vector<int>& columns) {
  return squares(normal, kBlocks, columns,
                 solved(normal.gram[kBlocks](columns, columns), normal.moment[kBlocks](columns), kRidge));
}

/// Each block predicted from the others.
double left_out_squares(const Normal& normal, const std::vector<int>& columns, double ridge) {
  double sum = 0.0;
  for (std::size_t b = 0; b < kBlocks; ++b) {
    const Eigen::MatrixXd gram = normal.gram[kBlocks](columns, columns) - normal.gram[b](columns, columns);
    const Eigen::VectorXd moment = normal.moment[kBlocks](columns) - normal.moment[b](columns);
    sum += squares(normal, b, columns, solved(gram, moment, ridge));
  }
  return sum;
}

struct Selected {
  std::vector<int> columns;
  std::vector<Claim> claims;
};

std::vector<int> with(std::vector<int> columns, const Variant& variant) {
  for (int i = 0; i < variant.count; ++i) columns.push_back(variant.first + i);
  return columns;
}

/// Adds the variant that lowers the criterion most, until none does or four effects are in.
template <class Criterion, class Probability>
Selected forward(const Library& library, Criterion&& criterion, Probability&& probability) {
  Selected selected;
  for (int i = 0; i < library.base; ++i) selected.columns.push_back(i);
  int searched = 0;
  double least = criterion(selected.columns, searched);
  for (int round = 0; round < 4; ++round) {
    const Variant* best = nullptr;
    double best_value = least;
    for (const Variant& variant : library.variants) {
      if (std::ranges::count(selected.claims, variant.effect, &Claim::effect) > 0) continue;
      const double value = criterion(with(selected.columns, variant), searched + (variant.searched ? 1 : 0));
      if (value < best_value) {
        best_value = value;
        best = &variant;
      }
    }
    if (best == nullptr) break;
    selected.columns = with(selected.columns, *best);
    selected.claims.push_back({std::string(best->effect), probability(least - best_value)});
    searched += best->searched ? 1 : 0;
    least = best_value;
  }
  return selected;
}

/// Sequentially thresholded least squares (Brunton, Proctor and Kutz, PNAS 2016): a column stays while what
/// it adds to the force is at least half the noise.
Selected thresholded(const Library& library, const Normal& normal, double noise_N) {
  std::vector<int> columns;
  for (int i = 0; i < library.columns.cols(); ++i) columns.push_back(i);
  std::vector<double> adds_N;
  for (int round = 0; round < 12; ++round) {
    const Eigen::VectorXd x = solved(normal.gram[kBlocks](columns, columns), normal.moment[kBlocks](columns), 1e-6);
    std::vector<int> kept;
    adds_N.clear();
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const double mean_square = normal.gram[kBlocks](columns[i], columns[i]) / normal.rows;
      const double adds = std::abs(x[static_cast<Eigen::Index>(i)]) * std::sqrt(mean_square);
      if (columns[i] >= library.base && adds < 0.5 * noise_N) continue;
      kept.push_back(columns[i]);
      adds_N.push_back(adds);
    }
    if (kept.size() == columns.size()) break;
    columns = kept;
  }
  Selected selected{columns, {}};
  std::vector<std::pair<double, std::string_view>> order;
  for (std::size_t i = 0; i < columns.size(); ++i)
    for (const Variant& v : library.variants)
      if (columns[i] >= v.first && columns[i] < v.first + v.count) order.emplace_back(-adds_N[i], v.effect);
  std::ranges::sort(order);
  for (const auto& [size, effect] : order)
    if (std::ranges::count(selected.claims, effect, &Claim::effect) == 0)
      selected.claims.push_back({std::string(effect), 1.0});
  return selected;
}

double rmse(const Eigen::VectorXd& difference) {
  return std::sqrt(difference.squaredNorm() / static_cast<double>(difference.size()));
}

/// From differences of neighbours, which no slow error reaches.
double noise_of(const Eigen::VectorXd& residual_N) {
  std::vector<double> steps;
  for (Eigen::Index i = 1; i < residual_N.size(); ++i) steps.push_back(std::abs(residual_N[i] - residual_N[i - 1]));
  return base::quantile(std::move(steps), 0.5) / (base::kNormalQuartile * std::sqrt(2.0));
}

Outcome chance(const std::string& case_name, double nominal_rmse_N) {
  Random random(1, case_name + "/chance");
  Outcome outcome;
  outcome.nominal_rmse_N = outcome.model_rmse_N = nominal_rmse_N;
  const std::size_t answers = named_effects().size() + 2;
  const std::size_t drawn = random.index(answers);
  outcome.verdict = drawn == 0 ? "consistent" : drawn == 1 ? "unknown_physics" : "missing_physics";
  if (drawn > 1) outcome.missing = {{std::string(named_effects()[drawn - 2].name), 1.0 / static_cast<double>(answers)}};
  return outcome;
}

/// Ridge regression of the residual on lagged positions; its penalty by cross-validation. Names nothing.
Outcome black_box(const messages::Recording& train, const messages::Recording& heldout,
                  const Eigen::VectorXd& residual_N, const Eigen::VectorXd& heldout_error_N) {
  const Eigen::MatrixXd columns = lagged_columns(train);
  const Normal normal(columns, residual_N);
  std::vector<int> all;
  for (int i = 0; i < columns.cols(); ++i) all.push_back(i);
  double best_ridge = INFINITY, least = residual_N.squaredNorm();
  const double none = least;
  for (const double ridge : {1e-8, 1e-6, 1e-4, 1e-2, 1.0}) {
    const double left_out = left_out_squares(normal, all, ridge);
    if (left_out < least) {
      least = left_out;
      best_ridge = ridge;
    }
  }
  Outcome outcome;
  outcome.nominal_rmse_N = outcome.model_rmse_N = rmse(heldout_error_N);
  outcome.verdict = least < 0.98 * none ? "unknown_physics" : "consistent";
  if (std::isfinite(best_ridge))
    outcome.model_rmse_N = rmse(heldout_error_N + lagged_columns(heldout) *
                                                      solved(normal.gram[kBlocks], normal.moment[kBlocks], best_ridge));
  return outcome;
}

}  // namespace

std::span<const std::string_view> baselines() {
  return kMethods;
}

std::vector<Outcome> run_baselines(const messages::Recording& train, const messages::Recording& heldout,
                                   const std::string& nominal, const std::vector<double>& truth_N,
                                   const std::string& case_name) {
  const messages::FrameSamples& frame = train.frame;
  const NominalFit fit = fit_nominal(frame.t_s, frame.position_mm, frame.force_N, nominal == "slse2" ? 2 : 1);
  const Library library = build_library(train, fit, likeliest_step_s(frame, fit.residual_N));
  const Library unseen = build_library(heldout, fit, INFINITY);
  // On the residual of the nominal fit, whose columns stay in: whatever is added may move its parameters.
  const Normal normal(library.columns, fit.residual_N);
  const Eigen::VectorXd nominal_heldout =
      nominal_columns(heldout.frame.t_s, heldout.frame.position_mm, fit.time_constants_s) * fit.coefficients;
  const Eigen::VectorXd error =
      nominal_heldout - Eigen::Map<const Eigen::VectorXd>(truth_N.data(), nominal_heldout.size());
  const double log_rows = std::log(normal.rows);
  const auto bic = [&](const std::vector<int>& columns, int searched) {
    return normal.rows * std::log(total_squares(normal, columns) / normal.rows) +
           static_cast<double>(static_cast<int>(columns.size()) + searched) * log_rows;
  };
  const auto left_out = [&](const std::vector<int>& columns, int) { return left_out_squares(normal, columns, kRidge); };

  const auto outcome_of = [&](const Selected& selected) {
    Outcome outcome;
    outcome.missing = selected.claims;
    outcome.verdict = selected.claims.empty() ? "consistent" : "missing_physics";
    const Eigen::VectorXd x = solved(normal.gram[kBlocks](selected.columns, selected.columns),
                                     normal.moment[kBlocks](selected.columns), kRidge);
    outcome.nominal_rmse_N = rmse(error);
    outcome.model_rmse_N = rmse(error + unseen.columns(Eigen::all, selected.columns) * x);
    return outcome;
  };
  std::vector<Outcome> outcomes;
  outcomes.push_back(chance(case_name, rmse(error)));
  outcomes.push_back(
      outcome_of(forward(library, bic, [](double gain) { return 1.0 / (1.0 + std::exp(-0.5 * gain)); })));
  outcomes.push_back(outcome_of(forward(library, left_out, [](double) { return 1.0; })));
  outcomes.push_back(outcome_of(thresholded(library, normal, noise_of(fit.residual_N))));
  outcomes.push_back(black_box(train, heldout, fit.residual_N, error));
  return outcomes;
}

}  // namespace isorig::proof
