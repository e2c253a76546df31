#include "identify/diagnose/fit/intervals.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify {

namespace {

/// Gradient of half the sum of squares, summed over every move with the rest after it.
Eigen::MatrixXd scores_by_move(std::span<const Series> series, const Eigen::MatrixXd& jacobian,
                               const Eigen::VectorXd& residual) {
  constexpr double kRest_s = 5.0;
  std::vector<Eigen::VectorXd> moves;
  Eigen::Index row = 0;
  for (const Series& each : series) {
    for (std::size_t k = 0; k < each.nodes.size(); ++k, ++row) {
      const bool starts = k > 0 && each.since_corner_s[k] == 0.0 && each.since_corner_s[k - 1] > kRest_s;
      if (k == 0 || starts) moves.emplace_back(Eigen::VectorXd::Zero(jacobian.cols()));
      moves.back() += jacobian.row(row).transpose() * residual[row];
    }
  }
  Eigen::MatrixXd out(jacobian.cols(), static_cast<Eigen::Index>(moves.size()));
  for (std::size_t m = 0; m < moves.size(); ++m) out.col(static_cast<Eigen::Index>(m)) = moves[m];
  return out;
}

}  // namespace

std::vector<std::vector<NamedValue>> intervals(const Problem& problem, const model::ModelSpec& spec, Spread spread) {
  struct Free {
    std::size_t part, index;
    bool parameter;
    double step;
  };
  std::vector<Free> free;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& part = spec.parts[p];
    if (part.fixed) continue;
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const auto& parameter = part.law->parameters[i];
      if (parameter.fixed) continue;
      if (parameter.name == "time_s") continue;  // of an event: no derivative leads anywhere
      const double step = parameter.logarithmic ? 1e-3 * std::fabs(part.parameters[i])
                                                : 1e-3 * std::max(std::fabs(part.parameters[i]), 1e-2);
      free.push_back({p, i, true, step});
    }
    for (std::size_t i = 0; i < part.coefficients.size(); ++i)
      if (part.coefficients[i] != 0.0) free.push_back({p, i, false, 1e-3 * std::fabs(part.coefficients[i])});
  }
  const auto residual_of = [&](const model::ModelSpec& s) {
    RowMatrix r = problem.target() - problem.predict(s);
    (void)whiten(problem.series(), problem.noise(), r);
    return Eigen::VectorXd(r.col(0));
  };
  const Eigen::VectorXd at = residual_of(spec);
  Eigen::MatrixXd jacobian(at.size(), static_cast<Eigen::Index>(free.size()));
  for (std::size_t i = 0; i < free.size(); ++i) {
    model::ModelSpec moved = spec;
    auto& part = moved.parts[free[i].part];
    (free[i].parameter ? part.parameters : part.coefficients)[free[i].index] += free[i].step;
    jacobian.col(static_cast<Eigen::Index>(i)) = residual_of(moved) - at;  // per step: well scaled
  }
  // Columns of equal length: a number near zero has a short step, and the rank must not hang on that.
  const Eigen::VectorXd length = jacobian.colwise().norm().transpose().cwiseMax(1e-300);
  jacobian.array().rowwise() /= length.transpose().array();
  const double scale = std::max(at.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(at.size(), 1)), 1.0);
  // What the recording cannot show has no curvature. A pseudo-inverse would call it known exactly; here it is
  // known to within 1e5 times what the same number alone would be, and a parameter to within its bounds.
  constexpr double kFlat = 1e-10;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> curvature(jacobian.transpose() * jacobian);
  const Eigen::VectorXd widths = curvature.eigenvalues().cwiseMax(kFlat).cwiseInverse();
  const Eigen::MatrixXd inverse = curvature.eigenvectors() * widths.asDiagonal() * curvature.eigenvectors().transpose();
  Eigen::VectorXd variance = scale * inverse.diagonal();
  if (spread == Spread::kMoves) {
    // What every move shifts the numbers by. Where moves disagree by more than noise allows, something is
    // left that the noise does not know of: a law of nearly the right form, an unsteady rig.
    const Eigen::MatrixXd shifts = inverse * scores_by_move(problem.series(), jacobian, at);
    const auto count = static_cast<double>(shifts.cols());
    constexpr double kFewest = 8.0;
    if (count >= kFewest) variance = variance.cwiseMax(count / (count - 1.0) * shifts.rowwise().squaredNorm());
  }
  // An event lies between two bins; further ones are allowed while the likelihood ratio stays within 95 %.
  const auto event_interval = [&](std::size_t p, std::size_t i, NamedValue& named) {
    const auto& nodes = problem.series()[0].nodes;
    const auto after = std::ranges::lower_bound(nodes, named.value, {}, &model::Instant::t_s) - nodes.begin();
    model::ModelSpec moved = spec;
    const auto allowed = [&](double time_s) {
      moved.parts[p].parameters[i] = time_s;
      return residual_of(moved).squaredNorm() - at.squaredNorm() < 3.84 * scale;
    };
    const auto last = std::ssize(nodes) - 1;
    auto low = std::clamp<std::ptrdiff_t>(after - 1, 0, last), high = std::clamp<std::ptrdiff_t>(after, 0, last);
    while (low > 0 && allowed(0.5 * (nodes[low - 1].t_s + nodes[low].t_s))) --low;
    while (high < last && allowed(0.5 * (nodes[high].t_s + nodes[high + 1].t_s))) ++high;
    named.low = std::min(named.value, nodes[low].t_s);
    named.high = std::max(named.value, nodes[high].t_s);
  };
  std::vector<std::vector<NamedValue>> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& part = spec.parts[p];
    auto& values = out.emplace_back();
    const auto add = [&](std::string_view name, double value, bool parameter, std::size_t index) {
      NamedValue named{std::string(name), value, value, value};
      for (std::size_t i = 0; i < free.size(); ++i) {
        if (free[i].part != p || free[i].index != index || free[i].parameter != parameter) continue;
        const auto d = static_cast<Eigen::Index>(i);
        const double half = 1.96 * free[i].step / length[d] * std::sqrt(std::max(variance[d], 0.0));
        named.low = value - half;
        named.high = value + half;
      }
      if (parameter) {
        named.low = std::max(named.low, part.law->parameters[index].lower);
        named.high = std::min(named.high, part.law->parameters[index].upper);
      }
      if (parameter && name == "time_s" && !part.fixed) event_interval(p, index, named);
      values.push_back(std::move(named));
    };
    for (std::size_t i = 0; i < part.coefficients.size(); ++i)
      add(part.law->coefficients[i].name, part.coefficients[i], false, i);
    for (std::size_t i = 0; i < part.parameters.size(); ++i)
      if (!part.law->parameters[i].fixed) add(part.law->parameters[i].name, part.parameters[i], true, i);
  }
  return out;
}

}  // namespace isorig::identify
