#include "identify/diagnose/forecast.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/intervals.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;

Eigen::VectorXd simulate(const ModelSpec& spec, const Excitation& excitation) {
  model::RunningModel running(spec, excitation.reference);
  running.reset(excitation.instants.front());
  Eigen::VectorXd force(static_cast<Eigen::Index>(excitation.instants.size()));
  Eigen::Index row = 0;
  for (const model::Instant& now : excitation.instants) force[row++] = running.step(now);
  return force;
}

}  // namespace

std::string unfit_seen(const ModelSpec& spec) {
  if (!spec.seen) return {};
  const std::size_t n = fitted_numbers(spec).size(), wanted = n * (n + 1) / 2;
  if (spec.seen->covariance.size() == wanted) return {};
  return "[seen] covariance has " + std::to_string(spec.seen->covariance.size()) + " numbers, and the " +
         std::to_string(n) + " fitted numbers of this model need " + std::to_string(wanted) +
         "; diagnose again, or leave [seen] out to predict without a band";
}

std::vector<double> lower_triangle(const Eigen::MatrixXd& matrix) {
  std::vector<double> out;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
    for (Eigen::Index j = 0; j <= i; ++j) out.push_back(matrix(i, j));
  return out;
}

Forecast forecast(const ModelSpec& spec, const Excitation& excitation) {
  constexpr double k95 = 1.96;
  Forecast out;
  const Eigen::VectorXd force = simulate(spec, excitation);
  if (!spec.seen) {
    out.force_N.assign(force.data(), force.data() + force.size());
    return out;
  }
  const model::Seen& seen = *spec.seen;
  const Eigen::VectorXd nominal = simulate({spec.name, seen.nominal}, excitation);
  const std::vector<FreeNumber> numbers = fitted_numbers(spec);
  const Eigen::MatrixXd jacobian =
      differences(spec, numbers, force, [&](const ModelSpec& moved) { return simulate(moved, excitation); });
  const auto n = static_cast<Eigen::Index>(numbers.size());
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0, next = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j, ++next) {
      const double value = seen.covariance[static_cast<std::size_t>(next)];
      const double steps = difference_step(spec, numbers[static_cast<std::size_t>(i)]) *
                           difference_step(spec, numbers[static_cast<std::size_t>(j)]);
      covariance(i, j) = covariance(j, i) = value / steps;
    }
  }
  const Eigen::VectorXd variance = (jacobian * covariance).cwiseProduct(jacobian).rowwise().sum().cwiseMax(0.0);

  Fading fading(spec, excitation);
  for (Eigen::Index row = 0; row < force.size(); ++row) {
    const auto [d, w] = fading.next(excitation.instants[static_cast<std::size_t>(row)]);
    const double beyond_N = force[row] - nominal[row];
    const double predicted_N = nominal[row] + w * beyond_N;
    const double half_N = k95 * std::sqrt((1.0 + d) * (1.0 + d) * seen.error_N * seen.error_N + variance[row]) +
                          (1.0 - w) * std::fabs(beyond_N);
    out.force_N.push_back(predicted_N);
    out.low95_N.push_back(predicted_N - half_N);
    out.high95_N.push_back(predicted_N + half_N);
    out.outside.push_back(d > 0.0 ? 1.0 : 0.0);
  }
  out.notes = fading.notes();
  return out;
}

}  // namespace isorig::identify
