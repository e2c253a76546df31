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
/// Times SeriesOptions::search_samples, for an arm that is too fast to show in those.
constexpr std::size_t kMoreSamples = 8;
/// Where an arm's decay ends: below 1e-308 processors take a hundred times as long for a product, and a fast arm is
/// there after a few samples of a hold. No sum of a record's numbers is changed by it.
constexpr double kRelaxed_mm = 1e-100;
constexpr double kLeastDecay = 1e-30;
/// Columns: 1, x, s_1..s_n, ds_1..ds_n by ln gamma, F.
constexpr int kColumns = 3 + 2 * kMost;

struct Data {
  std::span<const double> t_s, x_mm, force_N;
  double x_mean = 0.0, force_mean = 0.0;  ///< taken off: sums of squares of small numbers
};

/// All columns as R of M = Q R: sums of squares of M v and of R v are the same for every v.
using Triangle = Eigen::Matrix<double, kColumns, kColumns>;

/// R of all rows in one pass (a sequential QR: Golub & Van Loan 2013, 6.5): rows fill a block, then Householder
/// reflections fold it into the triangle above it. R'R would be the normal equations. They square the condition number,
/// so that two arms of nearly the same time constant would be lost in rounding.
class Folded {
 public:
  static constexpr int kRows = 128;
  /// Rows are written here; fold() leaves nothing of them.
  [[nodiscard]] auto& block() noexcept { return block_; }
  [[nodiscard]] const Triangle& triangle() const noexcept { return triangle_; }

  void fold() noexcept {
    Products products{};
    for (int j = 0; j < kColumns; ++j) products[static_cast<std::size_t>(j)] = block_.col(0).dot(block_.col(j));
    reflect<0>(products);
  }

 private:
  using Products = std::array<double, kColumns>;
  using Pair = Eigen::Array2d;  ///< of rows: what a register holds on every x86-64 and ARM

  /// H = 1 - tau w w',  w = (1, v / pivot),  pivot = r_kk + sgn(r_kk) |(r_kk, v)|,  tau = pivot / sgn(r_kk) |(r_kk, v)|
  /// for v, column k of the block: of the triangle it meets row k alone, for the rows between are zero there.
  /// `products` are those of v with the columns from k on. One sweep takes the columns behind along and has the next
  /// products.
  template <std::size_t k>
  void reflect(const Products& products) noexcept {
    std::array<Pair, kColumns> shares, sums;
    shares.fill(Pair::Zero());
    sums.fill(Pair::Zero());
    const auto at = static_cast<Eigen::Index>(k);
    if (products[k] != 0.0) {
      const double top = triangle_(at, at), length = std::copysign(std::sqrt(top * top + products[k]), top);
      const double pivot = top + length, tau = pivot / length;
      for (std::size_t j = k + 1; j < kColumns; ++j) {
        double& above = triangle_(at, static_cast<Eigen::Index>(j));
        const double share = tau * (above + products[j] / pivot);
        above -= share;
        shares[j] = share / pivot;
      }
      triangle_(at, at) = -length;
    }
    if constexpr (k + 1 < kColumns) {
      sweep<k>(shares, sums, std::make_index_sequence<kColumns - 1 - k>());
      Products next{};
      for (std::size_t j = k + 1; j < kColumns; ++j) next[j] = sums[j].sum();
      reflect<k + 1>(next);
    }
  }

  template <std::size_t k, std::size_t... behind>
  void sweep(const std::array<Pair, kColumns>& shares, std::array<Pair, kColumns>& sums,
             std::index_sequence<behind...> /*each*/) noexcept {
    std::array<Pair, sizeof...(behind)> share{shares[k + 1 + behind]...}, sum{sums[k + 1 + behind]...}, moved;
    for (Eigen::Index i = 0; i < kRows; i += 2) {
      const Pair v = pair(k, i);
      ((moved[behind] = pair(k + 1 + behind, i) - share[behind] * v), ...);
      ((pair(k + 1 + behind, i) = moved[behind]), ...);
      ((sum[behind] += moved[0] * moved[behind]), ...);
    }
    ((sums[k + 1 + behind] = sum[behind]), ...);
  }
  [[nodiscard]] Eigen::Map<Pair, Eigen::Aligned16> pair(std::size_t column, Eigen::Index row) noexcept {
    return Eigen::Map<Pair, Eigen::Aligned16>(block_.data() + column * kRows + static_cast<std::size_t>(row));
  }

  Eigen::Matrix<double, kRows, kColumns> block_ = decltype(block_)::Zero();
  Triangle triangle_ = Triangle::Zero();
};

/// Elongations s of the Maxwell arms as the samples go by, and their slopes by ln gamma. An arm that is not there stays
/// at zero.
class Arms {
 public:
  explicit Arms(const Eigen::VectorXd& log_gamma) : gamma_per_s_(Each::Zero()) {
    gamma_per_s_.head(log_gamma.size()) = log_gamma.array().exp();
  }
  void set_step(double dt_s) noexcept {
    for (int j = 0; j < kMost; ++j) {
      if (gamma_per_s_[j] == 0.0) continue;
      const double z = gamma_per_s_[j] * dt_s;
      const model::Relaxation step = model::relaxation(z);
      decay_[j] = step.decay > kLeastDecay ? step.decay : 0.0;
      gain_[j] = step.gain;
      decay_slope_[j] = -z * decay_[j];
      gain_slope_[j] = step.decay - step.gain;
      relaxed_mm_[j] = kRelaxed_mm;
    }
  }
  /// s' = s e^-z + dx (1 - e^-z)/z, and d/d(ln gamma) of it
  void step(double dx_mm) noexcept {
    slope_mm_ = slope_mm_ * decay_ + (elongation_mm_ * decay_slope_ + (dx_mm * gain_slope_ + relaxed_mm_));
    elongation_mm_ = elongation_mm_ * decay_ + (dx_mm * gain_ + relaxed_mm_);
  }
  using Each = Eigen::Array<double, kMost, 1>;
  [[nodiscard]] const Each& elongation_mm() const noexcept { return elongation_mm_; }
  [[nodiscard]] const Each& slope_mm() const noexcept { return slope_mm_; }

 private:
  Each gamma_per_s_, elongation_mm_ = Each::Zero(), slope_mm_ = Each::Zero();
  Each decay_ = Each::Zero(), gain_ = Each::Zero(), decay_slope_ = Each::Zero(), gain_slope_ = Each::Zero();
  Each relaxed_mm_ = Each::Zero();
};

/// One pass. Columns of arms that are not there stay zero.
Triangle triangle(const Data& d, const Eigen::VectorXd& log_gamma) {
  Arms arms(log_gamma);
  Folded rows;
  auto& block = rows.block();
  double dt_s = -1.0, x_before_mm = d.x_mm[0], t_before_s = d.t_s[0];
  for (std::size_t begin = 0; begin < d.t_s.size(); begin += Folded::kRows) {
    const auto count = static_cast<int>(std::min<std::size_t>(Folded::kRows, d.t_s.size() - begin));
    if (count < Folded::kRows) block.setZero();
    for (int i = 0; i < count; ++i) {
      const std::size_t at = begin + static_cast<std::size_t>(i);
      const double t_s = d.t_s[at], x_mm = d.x_mm[at];
      // Nearly uniform sampling differs in the last digits of the stamps only: 1 ns of it is no physics.
      if (at > 0 && std::abs(t_s - t_before_s - dt_s) > 1e-9) {
        dt_s = t_s - t_before_s;
        arms.set_step(dt_s);
      }
      arms.step(x_mm - x_before_mm);
      t_before_s = t_s;
      x_before_mm = x_mm;
      block(i, 0) = 1.0;
      block(i, 1) = x_mm - d.x_mean;
      for (int j = 0; j < kMost; ++j) {
        block(i, 2 + j) = arms.elongation_mm()[j];
        block(i, 2 + kMost + j) = arms.slope_mm()[j];
      }
      block(i, kColumns - 1) = d.force_N[at] - d.force_mean;
    }
    rows.fold();
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
  bool arrived = false;  ///< within bounds, where no step is worth taking
  SeriesStop stop = SeriesStop::kIterationLimit;
};

/// How a search goes about it.
struct Pace {
  int iterations;
  double radius;      ///< how far the first step trusts the slopes
  double least_gain;  ///< a step that lowers the sum of squares by less than this share of it is the last
  double least_step;  ///< of ln gamma; a shorter step is not taken
};
constexpr Pace kAmongStarts{12, 1e3, 1e-5, 1e-3};
constexpr Pace kFromOneStart{40, 1e3, 1e-10, 1e-3};
constexpr Pace kNearby{40, 1e4, 1e-10, 1e-7};

/// Ends a search whose next step would be too short to take. Ceres looks when it has already passed over all samples
/// for it.
class Arrived final : public ceres::IterationCallback {
 public:
  Arrived(const SeriesCost& cost, const Eigen::VectorXd& log_gamma, double least_step)
      : cost_(cost), log_gamma_(log_gamma), least_step_(least_step) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (!summary.step_is_successful && summary.iteration > 0) return ceres::SOLVER_CONTINUE;
    const Projected& now = cost_.at(log_gamma_);
    const double step = now.jacobian.colPivHouseholderQr().solve(now.residual).norm();
    return step < least_step_ ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  const SeriesCost& cost_;
  const Eigen::VectorXd& log_gamma_;
  const double least_step_;
};

/// Levenberg-Marquardt on ln gamma within bounds, its steps by QR.
Outcome descend(const Data& d, const Eigen::VectorXd& at, double low, double high, const Pace& pace) {
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
  options.initial_trust_region_radius = pace.radius;
  options.max_num_iterations = pace.iterations;
  options.function_tolerance = pace.least_gain;
  options.parameter_tolerance = 1e-7;
  Arrived arrived(cost, out.log_gamma, pace.least_step);
  options.callbacks.push_back(&arrived);
  options.update_state_every_iteration = true;
  options.gradient_tolerance = 1e-16;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  out.projected = cost.at(out.log_gamma);
  out.triangle = cost.last_triangle();
  out.ssr = out.projected.residual.squaredNorm();
  out.evaluations = cost.passes();
  out.arrived = summary.termination_type == ceres::USER_SUCCESS;
  if (summary.termination_type == ceres::FAILURE)
    out.stop = SeriesStop::kFailed;
  else if (summary.termination_type != ceres::NO_CONVERGENCE)
    out.stop = (out.log_gamma.array() <= low || out.log_gamma.array() >= high).any() ? SeriesStop::kAtBounds
                                                                                     : SeriesStop::kConverged;
  return out;
}

/// Every so many samples of a record: at most about twice `samples`.
class Thinned {
 public:
  Thinned(const Data& all, std::size_t samples) {
    const std::size_t n = all.t_s.size(), every = std::max<std::size_t>(1, n / samples);
    if (every == 1) {
      data_ = all;
      return;
    }
    for (std::size_t i = 0; i < n; i += every) {
      t_s_.push_back(all.t_s[i]);
      x_mm_.push_back(all.x_mm[i]);
      force_N_.push_back(all.force_N[i]);
    }
    data_ = {t_s_, x_mm_, force_N_, all.x_mean, all.force_mean};
  }
  Thinned(const Thinned&) = delete;
  Thinned& operator=(const Thinned&) = delete;
  [[nodiscard]] const Data& data() const noexcept { return data_; }

 private:
  std::vector<double> t_s_, x_mm_, force_N_;
  Data data_;
};

/// The starts: decades that lie apart, the faster arm first.
std::vector<Eigen::VectorXd> starts(int arms) {
  std::vector<Eigen::VectorXd> out;
  const std::vector<double> decades{0.02, 0.1, 0.5, 2.5, 12.0, 60.0};
  for (std::size_t i = 0; i < decades.size(); ++i) {
    if (arms == 1) out.push_back(Eigen::VectorXd::Constant(1, std::log(decades[i])));
    for (std::size_t j = i + 1; arms == 2 && j < decades.size(); j += 2)
      out.push_back(Eigen::Vector2d(std::log(decades[j]), std::log(decades[i])));
  }
  return out;
}

/// Where to begin on all samples: where the best of the starts leads to on few samples. A fast arm may not show in
/// them; the search then goes on among more.
Eigen::VectorXd search(const Data& all, const std::vector<Eigen::VectorXd>& from, double low, double high,
                       std::size_t samples) {
  Outcome best;
  const Thinned few(all, samples);
  for (const auto& start : from) {
    Outcome o = descend(few.data(), start, low, high, from.size() > 1 ? kAmongStarts : kFromOneStart);
    if (o.ssr < best.ssr) best = std::move(o);
  }
  if (best.arrived || best.log_gamma.size() == 0) return best.log_gamma;
  const Thinned more(all, kMoreSamples * samples);
  return descend(more.data(), best.log_gamma, low, high, kFromOneStart).log_gamma;
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
  for (std::size_t i = 0; i < t_s.size(); ++i) out[i] = fit.offset_N.value + fit.stiffness_N_mm.value * position_mm[i];
  for (const SeriesArm& arm : fit.arms) {
    const double gamma_per_s = arm.gamma_per_s.value, stiffness_N_mm = arm.stiffness_N_mm.value;
    model::Relaxation r;
    double s_mm = 0.0, dt_s = -1.0;
    for (std::size_t i = 1; i < t_s.size(); ++i) {
      const double now_s = t_s[i] - t_s[i - 1];
      // The last digits of stamps, where sampling is uniform: a billionth of gamma.
      if (!(std::abs(now_s - dt_s) <= 1e-9 * dt_s)) {
        dt_s = now_s;
        r = model::relaxation(gamma_per_s * dt_s);
        if (r.decay < kLeastDecay) r.decay = 0.0;
      }
      s_mm = s_mm * r.decay + ((position_mm[i] - position_mm[i - 1]) * r.gain + kRelaxed_mm);
      out[i] += stiffness_N_mm * s_mm;
    }
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
    all.x_mean += position_mm[i];
    all.force_mean += force_N[i];
  }
  all.x_mean /= static_cast<double>(n);
  all.force_mean /= static_cast<double>(n);
  const double span_s = t_s.back() - t_s.front();
  // A time constant is seen between a fifth of the densest spacing and the whole record.
  double densest_s = span_s;
  for (std::size_t i = 1; i < n; ++i) densest_s = std::min(densest_s, t_s[i] - t_s[i - 1]);
  const double low = std::log(1.0 / span_s), high = std::log(5.0 / densest_s);

  std::vector<Eigen::VectorXd> from = starts(arms);
  if (static_cast<int>(options.start_gamma_per_s.size()) == arms)
    from = {Eigen::Map<const Eigen::VectorXd>(options.start_gamma_per_s.data(), arms).array().log()};
  Outcome best;
  best.log_gamma = search(all, from, low, high, options.search_samples);
  const auto finite = [&] {
    return best.log_gamma.size() == arms && best.log_gamma.allFinite() && std::isfinite(best.ssr) &&
           best.projected.linear.allFinite();
  };
  if (best.log_gamma.size() == arms && best.log_gamma.allFinite())
    best = descend(all, best.log_gamma, low, high, kNearby);
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
