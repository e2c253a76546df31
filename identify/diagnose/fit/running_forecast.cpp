#include "identify/diagnose/fit/running_forecast.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "identify/diagnose/fit/intervals.hpp"

namespace isorig::identify {

using model::ModelSpec;

std::string unfit_seen(const ModelSpec& spec) {
  if (!spec.seen) return {};
  const std::size_t n = fitted_numbers(spec).size(), wanted = n * (n + 1) / 2;
  if (spec.seen->covariance.size() == wanted) return {};
  return "[seen] covariance has " + std::to_string(spec.seen->covariance.size()) + " numbers, and the " +
         std::to_string(n) + " fitted numbers of this model need " + std::to_string(wanted) +
         "; diagnose again, or leave [seen] out to predict without a band";
}

RunningForecast::RunningForecast(const ModelSpec& spec, const model::Reference& reference, const ReadingNoise& noise)
    : model_(spec, reference) {
  if (!spec.seen) return;
  if (const std::string why = unfit_seen(spec); !why.empty()) throw std::invalid_argument(why);
  const model::Seen& seen = *spec.seen;
  error_N_ = seen.error_N;
  if (is_of_others(spec, reference)) zero_variance_N2_ = variance_of_further_zero_N2(spec);
  nominal_.emplace_back(fades_to(spec), reference);
  const std::vector<FreeNumber> numbers = fitted_numbers(spec);
  const auto n = static_cast<Eigen::Index>(numbers.size());
  std::vector<double> steps;
  for (const FreeNumber& number : numbers) {
    steps.push_back(difference_step(spec, number));
    ModelSpec moved = spec;
    value_of(moved, number) += steps.back();
    moved_.emplace_back(moved, reference);
  }
  covariance_.resize(n, n);
  for (Eigen::Index i = 0, next = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j, ++next) {
      covariance_(i, j) = covariance_(j, i) = seen.covariance[static_cast<std::size_t>(next)] /
                                              (steps[static_cast<std::size_t>(i)] * steps[static_cast<std::size_t>(j)]);
    }
  }
  change_N_.resize(n);
  fading_.emplace_back(spec, reference.nominal_pressure_psi, noise);
}

void RunningForecast::reset(const model::Instant& first) noexcept {
  model_.reset(first);
  for (model::RunningModel& each : nominal_) each.reset(first);
  for (model::RunningModel& each : moved_) each.reset(first);
  for (Fading& fading : fading_) fading.begin(first);
}

RunningForecast::Row RunningForecast::step(const model::Instant& now, bool unread) {
  constexpr double k95 = 1.96;
  const double force_N = model_.step(now);
  if (nominal_.empty()) return {force_N, 0.0, false};
  const double nominal_N = nominal_.front().step(now);
  for (std::size_t i = 0; i < moved_.size(); ++i)
    change_N_[static_cast<Eigen::Index>(i)] = moved_[i].step(now) - force_N;
  const double variance_N2 = moved_.empty() ? 0.0 : std::max(0.0, change_N_.dot(covariance_ * change_N_));
  const auto [d, seen] = fading_.front().next(now);
  const double w = unread ? 0.0 : seen;
  const double beyond_N = force_N - nominal_N;
  const double half_N = k95 * std::sqrt((1.0 + d) * (1.0 + d) * error_N_ * error_N_ + variance_N2 + zero_variance_N2_) +
                        (1.0 - w) * std::fabs(beyond_N);
  return {nominal_N + w * beyond_N, half_N, unread || d > 0.0};
}

std::vector<std::string> RunningForecast::notes() const {
  return fading_.empty() ? std::vector<std::string>{} : fading_.front().notes();
}

}  // namespace isorig::identify
