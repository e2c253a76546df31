#include "identify/diagnose/fit/intervals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/blocks.hpp"
#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {

namespace {

/// What may disagree within the recordings: moves, each with the rest after it; where there are too few, strokes; where
/// these are too few, what is left out together (blocks.hpp: four to seven moves, which say nothing, or stretches of
/// time).
MoveNumbers disagreeing_parts(std::span<const Series> series) {
  const auto enough = [](std::size_t count) {
    return static_cast<double>(count) >= deciding().fewest_moves_for_spread;
  };
  MoveNumbers moves = number_moves(series);
  if (enough(moves.count)) return moves;
  Blocks blocks = strokes_of(series);
  if (!enough(blocks.count)) blocks = blocks_of(series);
  return {std::move(blocks.of_bin), blocks.count};
}

/// Gradient of half the sum of squares, summed over every part: one column each.
Eigen::MatrixXd scores_by_part(const MoveNumbers& parts, const Eigen::MatrixXd& jacobian,
                               const Eigen::VectorXd& residual) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(jacobian.cols(), static_cast<Eigen::Index>(parts.count));
  for (std::size_t bin = 0; bin < parts.of_bin.size(); ++bin) {
    const auto row = static_cast<Eigen::Index>(bin);
    out.col(static_cast<Eigen::Index>(parts.of_bin[bin])) += jacobian.row(row).transpose() * residual[row];
  }
  return out;
}

/// Whitened residual of a model as it stands.
Eigen::VectorXd residual_of(const Problem& problem, const model::ModelSpec& spec) {
  RowMatrix r = problem.target() - problem.predict(spec);
  (void)whiten(problem.series(), problem.noise(), r);
  return r.col(0);
}

/// How the squares bend around a fit.
///
///     J    whitened residual by the numbers, columns scaled to length one
///     C    (J'J)^-1 with eigenvalues of J'J held above kFlat
struct Curvature {
  Eigen::VectorXd residual;
  Eigen::MatrixXd jacobian, inverse;
  Eigen::VectorXd unit;  ///< of each number, by which its scaled column is multiplied

  Curvature(const Problem& problem, const model::ModelSpec& spec, const std::vector<FreeNumber>& numbers)
      : residual(residual_of(problem, spec)) {
    jacobian = differences(spec, numbers, residual,
                           [&](const model::ModelSpec& moved) { return residual_of(problem, moved); });
    const Eigen::VectorXd length = jacobian.colwise().norm().transpose().cwiseMax(1e-300);
    jacobian.array().rowwise() /= length.transpose().array();
    // A number that the recording does not determine has no curvature, and a pseudo-inverse would give it zero
    // variance. Eigenvalues are therefore held at kFlat or more: its standard error is then up to 1e5 times what it
    // would be if it alone were unknown, and a parameter's interval ends at its bounds.
    constexpr double kFlat = 1e-10;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> curvature(jacobian.transpose() * jacobian);
    const Eigen::VectorXd widths = curvature.eigenvalues().cwiseMax(kFlat).cwiseInverse();
    inverse = curvature.eigenvectors() * widths.asDiagonal() * curvature.eigenvectors().transpose();
    unit.resize(length.size());
    for (Eigen::Index i = 0; i < unit.size(); ++i)
      unit[i] = difference_step(spec, numbers[static_cast<std::size_t>(i)]) / length[i];
  }
};

/// Variances of the numbers that the parts of the recordings disagree by; zero where they are too few.
Eigen::VectorXd disagreement(const Curvature& at, std::span<const Series> series) {
  const MoveNumbers parts = disagreeing_parts(series);
  const auto count = static_cast<double>(parts.count);
  if (count < deciding().fewest_moves_for_spread) return Eigen::VectorXd::Zero(at.unit.size());
  const Eigen::MatrixXd shifts = at.inverse * scores_by_part(parts, at.jacobian, at.residual);
  return count / (count - 1.0) * shifts.rowwise().squaredNorm().cwiseProduct(at.unit.cwiseAbs2());
}

/// Covariance of the numbers. Correlations are those of C under the problem's noise. kNoise: var = s2 diag(C), the
/// inverse curvature of the likelihood (Seber & Wild 1989, 5.1), s2 the mean square of what is left and at least 1,
/// since model error widens the interval. kMoves: with g_m the gradient summed over move m of M, var = M/(M-1) diag(C
/// (sum_m g_m g_m') C) where that is more: the sandwich of Liang & Zeger (1986), clustered by move (by stroke or
/// stretch of time where there are too few moves). Moves that disagree by more than noise allows show a law of nearly
/// the right form, an unsteady rig, or two recordings that are not alike. Too few say nothing about their own spread.
Eigen::MatrixXd covariance_of(const Problem& problem, const model::ModelSpec& spec,
                              const std::vector<FreeNumber>& numbers, Spread spread, const NoiseModel& fitted_under) {
  const Curvature at(problem, spec, numbers);
  const double scale =
      std::max(at.residual.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(at.residual.size(), 1)), 1.0);
  Eigen::VectorXd variance = scale * at.inverse.diagonal().cwiseProduct(at.unit.cwiseAbs2());
  if (spread == Spread::kMoves) {
    // The gradients add up to zero only under the noise that the numbers minimise the squares of.
    variance = variance.cwiseMax(
        fitted_under == problem.noise()
            ? disagreement(at, problem.series())
            : disagreement(Curvature(Problem(problem.series(), fitted_under), spec, numbers), problem.series()));
  }
  Eigen::VectorXd errors(variance.size());
  for (Eigen::Index i = 0; i < errors.size(); ++i)
    errors[i] = std::sqrt(std::max(variance[i] / std::max(at.inverse(i, i), 1e-300), 0.0));
  return errors.asDiagonal() * at.inverse * errors.asDiagonal();
}

/// How far from zero a coefficient may be that its sign holds there. Without the sign the squares would be least at c0,
/// as a rule on the side that is not allowed (there it is negative here); c is allowed while the likelihood ratio to
/// zero stays within its 95 %:
///
///     (c - c0)^2 - c0^2 = 3.84 var(c),   c = 3.84 var(c) / (sqrt(c0^2 + 3.84 var(c)) - c0)
///
/// (the root c0 + sqrt(...), without a difference of two large numbers). var(c) as of any other number (covariance_of).
/// Without end where the recording does not determine the coefficient, since nothing moves what it multiplies.
double reach_from_zero(const Problem& problem, const model::ModelSpec& spec, std::vector<FreeNumber> numbers,
                       const FreeNumber& held, Spread spread, const NoiseModel& fitted_under) {
  numbers.push_back(held);
  const Curvature at(problem, spec, numbers);
  const Eigen::Index last = at.unit.size() - 1;
  const double unsigned_c = -at.unit[last] * at.inverse.row(last).dot(at.jacobian.transpose() * at.residual);
  const model::Sign sign = spec.parts[held.part].law->coefficients[held.index].sign;
  const double c0 = sign == model::Sign::kNonNegative ? unsigned_c : -unsigned_c;
  const double variance = covariance_of(problem, spec, numbers, spread, fitted_under)(last, last);
  const double allowed = 3.84 * variance;
  const double reach = allowed / (std::sqrt(c0 * c0 + allowed) - c0);
  return std::isfinite(reach) ? reach : std::numeric_limits<double>::infinity();
}

/// The time of an event lies between two bins; further ones are allowed while the likelihood ratio stays within its
/// 95 % (3.84, chi-square of one degree).
void set_event_interval(const Problem& problem, const model::ModelSpec& spec, std::size_t part, std::size_t index,
                        NamedValue& named) {
  const auto& nodes = problem.series()[series_of(spec.parts[part], problem.series())].nodes;
  const double least = residual_of(problem, spec).squaredNorm();
  const double scale = std::max(least / static_cast<double>(problem.target().size()), 1.0);
  model::ModelSpec moved = spec;
  const auto allowed = [&](double time_s) {
    moved.parts[part].parameters[index] = time_s;
    return residual_of(problem, moved).squaredNorm() - least < deciding().event_time_squares * scale;
  };
  const auto after = std::ranges::lower_bound(nodes, named.value, {}, &model::Instant::t_s) - nodes.begin();
  const auto last = std::ssize(nodes) - 1;
  auto low = std::clamp<std::ptrdiff_t>(after - 1, 0, last), high = std::clamp<std::ptrdiff_t>(after, 0, last);
  while (low > 0 && allowed(0.5 * (nodes[low - 1].t_s + nodes[low].t_s))) --low;
  while (high < last && allowed(0.5 * (nodes[high].t_s + nodes[high + 1].t_s))) ++high;
  named.low = std::min(named.value, nodes[low].t_s);
  named.high = std::max(named.value, nodes[high].t_s);
}

}  // namespace

std::vector<FreeNumber> fitted_numbers(const model::ModelSpec& spec) {
  std::vector<FreeNumber> numbers = free_parameters(spec);
  for (const FreeNumber& coefficient : free_coefficients(spec))
    if (value_of(spec, coefficient) != 0.0) numbers.push_back(coefficient);
  return numbers;
}

Eigen::MatrixXd covariance(const Problem& problem, const model::ModelSpec& spec, Spread spread,
                           const std::optional<NoiseModel>& fitted_under) {
  return covariance_of(problem, spec, fitted_numbers(spec), spread, fitted_under.value_or(problem.noise()));
}

Eigen::VectorXd variance_by_numbers(const model::ModelSpec& spec, const std::vector<FreeNumber>& numbers,
                                    const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& differences) {
  Eigen::MatrixXd jacobian = differences;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    jacobian.col(static_cast<Eigen::Index>(i)) /= difference_step(spec, numbers[i]);
  const Eigen::MatrixXd bounded = covariance.unaryExpr([](double v) { return std::isfinite(v) ? v : 0.0; });
  return (jacobian * bounded).cwiseProduct(jacobian).rowwise().sum();
}

std::vector<std::vector<NamedValue>> intervals(const Problem& problem, const model::ModelSpec& spec, Spread spread,
                                               const std::optional<NoiseModel>& fitted_under) {
  constexpr double k95 = 1.96;
  const std::vector<FreeNumber> numbers = fitted_numbers(spec);
  const Eigen::VectorXd errors =
      covariance_of(problem, spec, numbers, spread, fitted_under.value_or(problem.noise())).diagonal().cwiseSqrt();
  const auto half_width = [&](const FreeNumber& of) {
    for (std::size_t i = 0; i < numbers.size(); ++i)
      if (numbers[i] == of) return k95 * errors[static_cast<Eigen::Index>(i)];
    return 0.0;
  };
  std::vector<std::vector<NamedValue>> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& part = spec.parts[p];
    auto& values = out.emplace_back();
    for (std::size_t i = 0; i < part.coefficients.size(); ++i) {
      const double value = part.coefficients[i], half = half_width({p, i, true});
      NamedValue named{std::string(part.law->coefficients[i].name), value, value - half, value + half};
      if (const model::Sign sign = part.law->coefficients[i].sign;
          value == 0.0 && sign != model::Sign::kFree && !part.fixed) {
        const double reach =
            reach_from_zero(problem, spec, numbers, {p, i, true}, spread, fitted_under.value_or(problem.noise()));
        (sign == model::Sign::kNonNegative ? named.high : named.low) =
            sign == model::Sign::kNonNegative ? reach : -reach;
      }
      values.push_back(std::move(named));
    }
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const model::Parameter& parameter = part.law->parameters[i];
      if (parameter.fixed) continue;
      const double value = part.parameters[i], half = half_width({p, i, false});
      NamedValue named{std::string(parameter.name), value, std::max(value - half, parameter.lower),
                       std::min(value + half, parameter.upper)};
      if (parameter.traits.event_time && !part.fixed) set_event_interval(problem, spec, p, i, named);
      values.push_back(std::move(named));
    }
    for (NamedValue& value : values) value.law = part.law;
  }
  return out;
}

}  // namespace isorig::identify
