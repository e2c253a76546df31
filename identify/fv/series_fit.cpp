#include "identify/fv/series_fit.hpp"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "model/slse.hpp"

namespace isorig::identify {
namespace {

constexpr int kMost = 2;
/// Columns: 1, x, s_1..s_n, ds_1..ds_n by ln gamma, F.
constexpr int kColumns = 3 + 2 * kMost;

struct Data {
  std::span<const double> t_s, x_mm, force_N;
  double x_mean = 0.0, force_mean = 0.0;  ///< taken off: sums of squares of small numbers
};

/// All columns as R of M = Q R: sums of squares of M v and of R v are the same for every v.
using Triangle = Eigen::Matrix<double, kColumns, kColumns>;

/// R of all rows in one pass (a sequential QR: Golub & Van Loan 2013, 6.5): rows fill the space under R, then
/// Householder reflections fold them into it. R'R would be the normal equations. They square the condition number, so
/// that two arms of nearly the same time constant would be lost in rounding.
class Folded {
 public:
  void add(const Eigen::Matrix<double, 1, kColumns>& row) {
    stack_.row(filled_++) = row;
    if (filled_ == stack_.rows()) fold();
  }
  [[nodiscard]] const Triangle& triangle() {
    fold();
    return triangle_;
  }

 private:
  static constexpr int kRows = 128;

  void fold() {
    const Eigen::HouseholderQR<Eigen::Ref<decltype(stack_)>> in_place(stack_);
    triangle_ = stack_.template topRows<kColumns>().template triangularView<Eigen::Upper>();
    stack_.setZero();
    stack_.template topRows<kColumns>() = triangle_;
    filled_ = kColumns;
  }

  Eigen::Matrix<double, kColumns + kRows, kColumns> stack_ = decltype(stack_)::Zero();
  Eigen::Index filled_ = kColumns;
  Triangle triangle_;
};

/// One pass. Columns of arms that are not there stay zero.
Triangle triangle(const Data& d, const Eigen::VectorXd& log_gamma) {
  const int n = static_cast<int>(log_gamma.size());
  std::array<double, kMost> gamma{}, s{}, ds{};
  for (int j = 0; j < n; ++j) gamma[static_cast<std::size_t>(j)] = std::exp(log_gamma[j]);
  std::array<model::Relaxation, kMost> step{};
  std::array<double, kMost> z{};
  Folded rows;
  Eigen::Matrix<double, 1, kColumns> row;
  row.setZero();
  row[0] = 1.0;
  double previous_dt = -1.0;
  for (std::size_t i = 0; i < d.t_s.size(); ++i) {
    if (i > 0) {
      const double dt = d.t_s[i] - d.t_s[i - 1];
      // Nearly uniform sampling differs in the last digits of the stamps only: 1 ns of it is no physics.
      if (std::abs(dt - previous_dt) > 1e-9) {
        for (std::size_t j = 0; j < kMost; ++j) {
          z[j] = gamma[j] * dt;
          step[j] = model::relaxation(z[j]);
        }
        previous_dt = dt;
      }
      const double dx = d.x_mm[i] - d.x_mm[i - 1];
      for (std::size_t j = 0; j < kMost; ++j) {
        // d/d(ln gamma) of  s' = s e^-z + dx (1 - e^-z)/z
        ds[j] = ds[j] * step[j].decay - z[j] * step[j].decay * s[j] + dx * (step[j].decay - step[j].gain);
        s[j] = s[j] * step[j].decay + dx * step[j].gain;
      }
    }
    row[1] = d.x_mm[i] - d.x_mean;
    for (int j = 0; j < n; ++j) {
      row[2 + j] = s[static_cast<std::size_t>(j)];
      row[2 + kMost + j] = ds[static_cast<std::size_t>(j)];
    }
    row[kColumns - 1] = d.force_N[i] - d.force_mean;
    rows.add(row);
  }
  return rows.triangle();
}

/// The linear coefficients at given gammas, and what the search for the gammas needs. With A the columns 1, x, s_j, f
/// the force, D the columns c_j ds_j / d(ln gamma_j) and P = 1 - A A^+, all in the coordinates of the triangle:
///
///     c = A^+ f,   residual = P f,   d residual / d(ln gamma) = -P D
///
/// The last leaves out that c itself changes with gamma beyond the projection (Kaufman 1975).
struct Projected {
  Eigen::VectorXd linear;  ///< a, k, c_j
  Eigen::Matrix<double, kColumns, 1> residual;
  Eigen::MatrixXd jacobian;
};
Projected project(const Triangle& r, int n) {
  Eigen::MatrixXd columns = r.leftCols(2 + n);
  // Scaled, so that one tolerance serves N, mm and 1.
  Eigen::VectorXd length = columns.colwise().norm();
  for (double& each : length)
    if (!(each > 0.0)) each = 1.0;
  columns = columns * length.cwiseInverse().asDiagonal();
  const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver(columns);
  const auto force = r.col(kColumns - 1);
  const Eigen::VectorXd scaled = solver.solve(force);
  Projected out;
  out.linear = scaled.cwiseQuotient(length);
  out.residual = force - columns * scaled;
  const Eigen::MatrixXd derivative = r.middleCols(2 + kMost, n) * out.linear.tail(n).asDiagonal();
  out.jacobian = columns * solver.solve(derivative) - derivative;
  return out;
}

/// The projected residual over the force's own size, for Ceres: 1 when nothing is explained. The residual's coordinates
/// turn with gamma, which changes neither squares nor slopes.
class SeriesCost final : public ceres::CostFunction {
 public:
  SeriesCost(const Data& data, int arms) : data_(data), arms_(arms) {
    set_num_residuals(kColumns);
    mutable_parameter_block_sizes()->push_back(arms);
  }
  [[nodiscard]] int passes() const noexcept { return passes_; }

  /// At these gammas: one pass, unless they are those of the last call.
  const Projected& at(const Eigen::VectorXd& log_gamma) const {
    if (passes_ > 0 && log_gamma == log_gamma_) return projected_;
    log_gamma_ = log_gamma;
    triangle_ = triangle(data_, log_gamma);
    projected_ = project(triangle_, arms_);
    ++passes_;
    return projected_;
  }
  [[nodiscard]] const Triangle& last_triangle() const noexcept { return triangle_; }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Projected& now = at(Eigen::Map<const Eigen::VectorXd>(parameters[0], arms_));
    const double force = triangle_.col(kColumns - 1).norm(), scale = force > 0.0 ? 1.0 / force : 1.0;
    Eigen::Map<Eigen::Matrix<double, kColumns, 1>>(residuals, kColumns) = scale * now.residual;
    if (jacobians != nullptr && jacobians[0] != nullptr)
      Eigen::Map<Eigen::Matrix<double, kColumns, Eigen::Dynamic, Eigen::RowMajor>>(jacobians[0], kColumns, arms_) =
          scale * now.jacobian;
    return now.residual.allFinite() && now.jacobian.allFinite();
  }

 private:
  const Data& data_;
  int arms_;
  mutable Eigen::VectorXd log_gamma_;  // Ceres asks for the residual first and for the slopes there later
  mutable Triangle triangle_;
  mutable Projected projected_;
  mutable int passes_ = 0;
};

struct Outcome {
  Eigen::VectorXd log_gamma;
  Triangle triangle;  ///< at log_gamma
  Projected projected;
  double ssr = std::numeric_limits<double>::infinity();
  int evaluations = 0;
  SeriesStop stop = SeriesStop::kIterationLimit;
};

/// Levenberg-Marquardt on ln gamma within bounds, its steps by QR.
Outcome descend(const Data& d, const Eigen::VectorXd& at, double low, double high, int iterations) {
  const int n = static_cast<int>(at.size());
  Outcome out;
  out.log_gamma = at.cwiseMax(low).cwiseMin(high);
  SeriesCost cost(d, n);
  if (!cost.at(out.log_gamma).residual.allFinite()) {  // Ceres would say so on standard error
    out.stop = SeriesStop::kFailed;
    return out;
  }
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  problem.AddResidualBlock(&cost, nullptr, out.log_gamma.data());
  for (int j = 0; j < n; ++j) {
    problem.SetParameterLowerBound(out.log_gamma.data(), j, low);
    problem.SetParameterUpperBound(out.log_gamma.data(), j, high);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.initial_trust_region_radius = 1e3;
  options.max_num_iterations = iterations;
  options.function_tolerance = 1e-10;
  options.parameter_tolerance = 1e-7;
  options.gradient_tolerance = 1e-16;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  out.projected = cost.at(out.log_gamma);
  out.triangle = cost.last_triangle();
  out.ssr = out.projected.residual.squaredNorm();
  out.evaluations = cost.passes();
  if (summary.termination_type == ceres::FAILURE)
    out.stop = SeriesStop::kFailed;
  else if (summary.termination_type == ceres::CONVERGENCE)
    out.stop = (out.log_gamma.array() <= low || out.log_gamma.array() >= high).any() ? SeriesStop::kAtBounds
                                                                                     : SeriesStop::kConverged;
  return out;
}

/// The best of several starts, on few samples.
Outcome search(const Data& all, int arms, double low, double high, std::size_t samples) {
  std::vector<double> t, x, f;
  const std::size_t n = all.t_s.size();
  const std::size_t every = std::max<std::size_t>(1, n / samples);
  for (std::size_t i = 0; i < n; i += every) {
    t.push_back(all.t_s[i]);
    x.push_back(all.x_mm[i]);
    f.push_back(all.force_N[i]);
  }
  const Data few{t, x, f, all.x_mean, all.force_mean};
  std::vector<Eigen::VectorXd> starts;
  const std::vector<double> decades{0.02, 0.1, 0.5, 2.5, 12.0, 60.0};
  for (std::size_t i = 0; i < decades.size(); ++i) {
    if (arms == 1) starts.push_back(Eigen::VectorXd::Constant(1, std::log(decades[i])));
    for (std::size_t j = i + 1; arms == 2 && j < decades.size(); j += 2)
      starts.push_back(Eigen::Vector2d(std::log(decades[j]), std::log(decades[i])));
  }
  Outcome best;
  for (const auto& start : starts) {
    Outcome o = descend(few, start, low, high, 12);
    if (o.ssr < best.ssr) best = std::move(o);
  }
  return best;
}

/// Residual r, its lag-1 correlation rho, and how many independent samples scatter as much (Bayley & Hammersley 1946):
/// n_eff = n (1 - rho) / (1 + rho). BIC = n_eff ln(SSR / n) + p ln n_eff (Schwarz 1978). Returns SSR.
double describe_residual(SeriesFit& fit, const Data& all, int arms) {
  const std::size_t n = fit.samples;
  const auto model = predict_series(fit, all.t_s, all.x_mm);
  double ssr = 0.0, lagged = 0.0, previous = 0.0, spread = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double r = all.force_N[i] - model[i];
    ssr += r * r;
    lagged += r * previous;
    previous = r;
    spread += (all.force_N[i] - all.force_mean) * (all.force_N[i] - all.force_mean);
  }
  fit.rms_N = std::sqrt(ssr / static_cast<double>(n));
  fit.r_squared = spread > 0.0 ? 1.0 - ssr / spread : std::numeric_limits<double>::quiet_NaN();
  fit.residual_correlation = ssr > 0.0 ? lagged / ssr : 0.0;
  const double rho = std::clamp(fit.residual_correlation, 0.0, 0.999);
  fit.effective_samples = static_cast<double>(n) * (1.0 - rho) / (1.0 + rho);
  const int parameters = 2 + 2 * arms;
  fit.bic = fit.effective_samples * std::log(ssr / static_cast<double>(n)) +
            parameters * std::log(std::max(fit.effective_samples, 2.0));
  return ssr;
}

/// Covariance of all p parameters, linear and nonlinear together: SSR / (n_eff - p) * (J'J)^-1, J the columns 1, x, s_j
/// and c_j ds_j / d(ln gamma_j) at the optimum, from the singular values of J. (Variance SSR / n * n_eff / (n_eff - p)
/// of a sample, of which only n_eff in n are independent.) False: the parameters cannot be told apart, and no error is
/// known.
bool set_standard_errors(SeriesFit& fit, const Outcome& best, double ssr, double x_mean) {
  constexpr double kTold =
      1e-10;  // of the largest singular value: rounding in the columns is 1e-6 of what is left there
  const int arms = static_cast<int>(fit.arms.size()), parameters = 2 + 2 * arms;
  const auto n = static_cast<double>(fit.samples);
  Eigen::MatrixXd jacobian(kColumns, parameters);
  jacobian.leftCols(2 + arms) = best.triangle.leftCols(2 + arms);
  jacobian.rightCols(arms) = best.triangle.middleCols(2 + kMost, arms) * best.projected.linear.tail(arms).asDiagonal();
  const Eigen::VectorXd scale = jacobian.colwise().norm().transpose().cwiseMax(1e-150).cwiseInverse();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(jacobian * scale.asDiagonal(), Eigen::ComputeThinU | Eigen::ComputeThinV);
  const double variance = ssr / std::max(1.0, fit.effective_samples - parameters) * fit.effective_samples / n;
  const double inflation = n / fit.effective_samples;
  const bool singular = !(svd.singularValues().minCoeff() > kTold * svd.singularValues().maxCoeff());
  auto error = [&](int i) {
    if (singular) return std::numeric_limits<double>::quiet_NaN();
    const double row = (svd.matrixV().row(i).transpose().array() / svd.singularValues().array()).matrix().norm();
    return row * scale[i] * std::sqrt(variance * inflation);
  };
  fit.offset_N.standard_error = std::hypot(error(0), x_mean * error(1));
  fit.stiffness_N_mm.standard_error = error(1);
  for (int j = 0; j < arms; ++j) {
    SeriesArm& arm = fit.arms[static_cast<std::size_t>(j)];
    arm.stiffness_N_mm.standard_error = error(2 + j);
    arm.gamma_per_s.standard_error = arm.gamma_per_s.value * error(2 + arms + j);
  }
  return !singular;
}

/// What of an arm is not identified, and why. [low, high]: logarithms of the rates that the record can show.
void note_doubts(SeriesFit& fit, int j, double log_gamma, double low, double high) {
  const SeriesArm& arm = fit.arms[static_cast<std::size_t>(j)];
  const double edge = 0.01;
  if (log_gamma < low + edge || log_gamma > high - edge)
    fit.statements.push_back("An arm's time constant lies at the edge of what this record can show (" +
                             std::to_string(1.0 / arm.gamma_per_s.value) + " s): it is not identified.");
  else if (!(arm.gamma_per_s.standard_error < 0.5 * arm.gamma_per_s.value))
    fit.statements.push_back(
        "The time constant of an arm is not identified: its standard error is as large as half "
        "of it.");
  if (arm.stiffness_N_mm.value < 0.0)
    fit.statements.push_back(
        "An arm came out with a negative stiffness, which no material has: the record holds "
        "something else (a lag between the channels, for one).");
}

}  // namespace

std::string_view name_of(SeriesStop stop) noexcept {
  switch (stop) {
    case SeriesStop::kConverged:
      return "converged";
    case SeriesStop::kAtBounds:
      return "at_bounds";
    case SeriesStop::kIterationLimit:
      return "iteration_limit";
    case SeriesStop::kFailed:
      return "failed";
  }
  return "";
}

std::vector<double> predict_series(const SeriesFit& fit, std::span<const double> t_s,
                                   std::span<const double> position_mm) {
  std::vector<double> out(t_s.size());
  std::vector<double> s(fit.arms.size(), 0.0);
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    double force = fit.offset_N.value + fit.stiffness_N_mm.value * position_mm[i];
    for (std::size_t j = 0; j < s.size(); ++j) {
      if (i > 0) {
        const auto r = model::relaxation(fit.arms[j].gamma_per_s.value * (t_s[i] - t_s[i - 1]));
        s[j] = s[j] * r.decay + (position_mm[i] - position_mm[i - 1]) * r.gain;
      }
      force += fit.arms[j].stiffness_N_mm.value * s[j];
    }
    out[i] = force;
  }
  return out;
}

SeriesFit fit_series(std::span<const double> t_s, std::span<const double> position_mm, std::span<const double> force_N,
                     int arms, const SeriesOptions& options) {
  if (arms < 1 || arms > kMost) throw std::invalid_argument("fit_series: 1 or 2 arms");
  if (t_s.size() != position_mm.size() || t_s.size() != force_N.size())
    throw std::invalid_argument("fit_series: columns of different lengths");
  if (t_s.size() < 20) throw std::invalid_argument("fit_series: fewer than 20 samples");
  const std::size_t n = t_s.size();
  Data all{t_s, position_mm, force_N};
  for (std::size_t i = 0; i < n; ++i) {
    all.x_mean += position_mm[i] / static_cast<double>(n);
    all.force_mean += force_N[i] / static_cast<double>(n);
  }
  const double span_s = t_s.back() - t_s.front();
  // A time constant is seen between a fifth of the densest spacing and the whole record.
  double densest_s = span_s;
  for (std::size_t i = 1; i < n; ++i) densest_s = std::min(densest_s, t_s[i] - t_s[i - 1]);
  const double low = std::log(1.0 / span_s), high = std::log(5.0 / densest_s);

  Outcome best;
  if (static_cast<int>(options.start_gamma_per_s.size()) == arms) {
    best.log_gamma.resize(arms);
    for (int j = 0; j < arms; ++j)
      best.log_gamma[j] = std::clamp(std::log(options.start_gamma_per_s[static_cast<std::size_t>(j)]), low, high);
  } else {
    best = search(all, arms, low, high, options.search_samples);
  }
  const auto finite = [&] {
    return best.log_gamma.size() == arms && best.log_gamma.allFinite() && std::isfinite(best.ssr) &&
           best.projected.linear.allFinite();
  };
  if (best.log_gamma.size() == arms && best.log_gamma.allFinite()) best = descend(all, best.log_gamma, low, high, 40);
  if (!finite()) throw std::domain_error("the record's numbers are too large or too small for sums of their squares");

  SeriesFit fit;
  fit.samples = n;
  fit.evaluations = best.evaluations;
  fit.stop = best.stop;
  const Eigen::VectorXd& c = best.projected.linear;
  fit.offset_N.value = c[0] + all.force_mean - c[1] * all.x_mean;
  fit.stiffness_N_mm.value = c[1];
  for (int j = 0; j < arms; ++j) {
    SeriesArm arm;
    arm.stiffness_N_mm.value = c[2 + j];
    arm.gamma_per_s.value = std::exp(best.log_gamma[j]);
    arm.kappa = c[2 + j] / c[1];
    fit.arms.push_back(arm);
  }

  const double ssr = describe_residual(fit, all, arms);
  const bool singular = !set_standard_errors(fit, best, ssr, all.x_mean);
  for (int j = 0; j < arms; ++j) note_doubts(fit, j, best.log_gamma[j], low, high);
  std::sort(fit.arms.begin(), fit.arms.end(),
            [](const SeriesArm& a, const SeriesArm& b) { return a.gamma_per_s.value > b.gamma_per_s.value; });
  if (singular) fit.statements.push_back("The parameters cannot be told apart from this record.");
  return fit;
}

}  // namespace isorig::identify
