#include "identify/fv/series_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
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

using Gram = Eigen::Matrix<double, kColumns, kColumns>;

/// One pass: all inner products. Columns of arms that are not there stay zero.
Gram gram(const Data& d, const Eigen::VectorXd& log_gamma) {
  const int n = static_cast<int>(log_gamma.size());
  std::array<double, kMost> gamma{}, s{}, ds{};
  for (int j = 0; j < n; ++j) gamma[static_cast<std::size_t>(j)] = std::exp(log_gamma[j]);
  std::array<model::Relaxation, kMost> step{};
  std::array<double, kMost> z{};
  Gram g = Gram::Zero();
  Eigen::Matrix<double, kColumns, 1> row;
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
    for (int a = 0; a < kColumns; ++a)
      for (int b = a; b < kColumns; ++b) g(a, b) += row[a] * row[b];
  }
  g.triangularView<Eigen::StrictlyLower>() = g.transpose();
  return g;
}

struct Reduced {
  double ssr = 0.0;
  Eigen::VectorXd linear;    ///< a, k, c_j
  Eigen::VectorXd gradient;  ///< of ssr/2 by ln gamma
  Eigen::MatrixXd curvature;
};

/// Everything the outer step needs, from the inner products alone. With A the columns 1, x, s_j, f the force and D the
/// columns c_j ds_j / d(ln gamma_j):
///
///     c = (A'A)^-1 A'f,   SSR = f'f - c'A'f
///     gradient of SSR / 2 = -D'(f - A c),   curvature = D'D - D'A (A'A)^-1 A'D
///
/// The curvature leaves out that c itself changes with gamma beyond the projection (Kaufman 1975).
Reduced reduce(const Gram& g, int n) {
  const int m = 2 + n;
  const int f = kColumns - 1;
  // Scaled, so that one tolerance serves N, mm and 1.
  Eigen::VectorXd scale(m);
  for (int i = 0; i < m; ++i) scale[i] = 1.0 / std::sqrt(std::max(g(i, i), 1e-300));
  const Eigen::MatrixXd normal = scale.asDiagonal() * g.topLeftCorner(m, m) * scale.asDiagonal();
  const Eigen::LDLT<Eigen::MatrixXd> solver(normal);
  Reduced out;
  out.linear = scale.asDiagonal() * solver.solve(scale.asDiagonal() * g.block(0, f, m, 1));
  out.ssr = g(f, f) - out.linear.dot(g.block(0, f, m, 1).col(0));
  Eigen::MatrixXd derivative(m, n);  // inner products of c_j ds_j with the columns
  Eigen::VectorXd with_force(n);
  Eigen::MatrixXd with_each(n, n);
  for (int j = 0; j < n; ++j) {
    const int dj = 2 + kMost + j;
    const double c = out.linear[2 + j];
    derivative.col(j) = c * g.block(0, dj, m, 1);
    with_force[j] = c * g(dj, f);
    for (int k = 0; k < n; ++k) with_each(j, k) = c * out.linear[2 + k] * g(dj, 2 + kMost + k);
  }
  const Eigen::MatrixXd projected = scale.asDiagonal() * solver.solve(scale.asDiagonal() * derivative);
  out.curvature = with_each - derivative.transpose() * projected;
  out.gradient = -(with_force - derivative.transpose() * out.linear);
  return out;
}

struct Outcome {
  Eigen::VectorXd log_gamma;
  Gram products;  ///< at log_gamma
  Reduced reduced;
  int evaluations = 0;
  bool converged = false;
};

/// Levenberg-Marquardt on ln gamma within bounds.
Outcome descend(const Data& d, const Eigen::VectorXd& at, double low, double high, int most) {
  const int n = static_cast<int>(at.size());
  const Gram first = gram(d, at);
  Outcome out{at, first, reduce(first, n), 1, false};
  double damping = 1e-3;
  while (out.evaluations < most) {
    Eigen::MatrixXd h = out.reduced.curvature;
    h.diagonal() += damping * h.diagonal() + Eigen::VectorXd::Constant(n, 1e-12 * out.reduced.ssr);
    Eigen::VectorXd step = -h.ldlt().solve(out.reduced.gradient);
    if (!step.allFinite()) break;
    step = step.cwiseMax(-2.0).cwiseMin(2.0);
    const Eigen::VectorXd next = (out.log_gamma + step).cwiseMax(low).cwiseMin(high);
    const double moved = (next - out.log_gamma).norm();
    if (moved < 1e-7) {
      out.converged = true;
      break;
    }
    const Gram products = gram(d, next);
    Reduced trial = reduce(products, n);
    ++out.evaluations;
    if (trial.ssr < out.reduced.ssr) {
      const double gain = (out.reduced.ssr - trial.ssr) / out.reduced.ssr;
      out.log_gamma = next;
      out.products = products;
      out.reduced = std::move(trial);
      damping = std::max(damping * 0.1, 1e-12);
      if (gain < 1e-10) {
        out.converged = true;
        break;
      }
    } else {
      if (moved < 1e-5) {
        out.converged = true;
        break;
      }
      damping *= 10.0;
      if (damping > 1e10) break;
    }
  }
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
  best.reduced.ssr = std::numeric_limits<double>::infinity();
  for (auto& start : starts) {
    start = start.cwiseMax(low).cwiseMin(high);
    Outcome o = descend(few, start, low, high, 12);
    if (o.reduced.ssr < best.reduced.ssr) best = o;
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

/// Covariance of all p parameters, linear and nonlinear together: SSR / (n_eff - p) * N^-1, N the inner products of the
/// columns 1, x, s_j and c_j ds_j / d(ln gamma_j) at the optimum. (Variance SSR / n * n_eff / (n_eff - p) of a sample,
/// of which only n_eff in n are independent.) False: the parameters cannot be told apart, and no error is known.
bool set_standard_errors(SeriesFit& fit, const Outcome& best, double ssr, double x_mean) {
  const int arms = static_cast<int>(fit.arms.size()), parameters = 2 + 2 * arms;
  const auto n = static_cast<double>(fit.samples);
  const Eigen::VectorXd& c = best.reduced.linear;
  const Gram& g = best.products;
  Eigen::MatrixXd normal(parameters, parameters);
  const std::size_t count = 2 + 2 * fit.arms.size();
  std::vector<int> column(count);
  std::vector<double> factor(count, 1.0);
  for (int i = 0; i < 2 + arms; ++i) column[static_cast<std::size_t>(i)] = i;
  for (std::size_t j = 0; j < fit.arms.size(); ++j) {
    column[2 + fit.arms.size() + j] = 2 + kMost + static_cast<int>(j);
    factor[2 + fit.arms.size() + j] = c[2 + static_cast<Eigen::Index>(j)];
  }
  for (int i = 0; i < parameters; ++i)
    for (int k = 0; k < parameters; ++k) {
      const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(k);
      normal(i, k) = g(column[a], column[b]) * factor[a] * factor[b];
    }
  const Eigen::VectorXd scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  const double variance = ssr / std::max(1.0, fit.effective_samples - parameters) * fit.effective_samples / n;
  const double inflation = n / fit.effective_samples;
  const bool singular = eigen.eigenvalues().minCoeff() < 1e-10 * eigen.eigenvalues().maxCoeff();
  auto error = [&](int i) {
    if (singular) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::VectorXd row = eigen.eigenvectors().row(i).transpose();
    const double v = (row.array().square() / eigen.eigenvalues().array()).sum() * scale[i] * scale[i];
    return std::sqrt(v * variance * inflation);
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
    return best.log_gamma.size() == arms && best.log_gamma.allFinite() && std::isfinite(best.reduced.ssr) &&
           best.reduced.linear.allFinite();
  };
  if (best.log_gamma.size() == arms && best.log_gamma.allFinite()) best = descend(all, best.log_gamma, low, high, 40);
  if (!finite()) throw std::domain_error("the record's numbers are too large or too small for sums of their squares");

  SeriesFit fit;
  fit.samples = n;
  fit.evaluations = best.evaluations;
  fit.converged = best.converged;
  const Eigen::VectorXd& c = best.reduced.linear;
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
