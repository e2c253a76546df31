#include "identify/diagnose/fit/many_starts.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"

namespace isorig::identify {
namespace {

/// The k-th point of van der Corput's sequence: the digits of k mirrored at the point.
double radical_inverse(std::size_t k, std::size_t base) {
  double value = 0.0, digit = 1.0 / static_cast<double>(base);
  for (; k > 0; k /= base, digit /= static_cast<double>(base)) value += digit * static_cast<double>(k % base);
  return value;
}

std::vector<model::ModelSpec> starts_of(const model::ModelSpec& spec, const std::vector<FreeNumber>& numbers) {
  constexpr std::size_t kSpread = 24;
  constexpr std::array<std::size_t, 8> kPrimes{2, 3, 5, 7, 11, 13, 17, 19};
  std::vector<model::ModelSpec> out{spec};
  if (numbers.empty()) return out;
  std::size_t most = 0;
  for (const FreeNumber& number : numbers) most = std::max(most, parameter_of(spec, number).starts.size());
  for (std::size_t k = 0; k < most; ++k) {
    out.push_back(spec);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const auto& given = parameter_of(spec, numbers[i]).starts;
      // Parts that are alike (two arms) begin apart.
      if (!given.empty()) value_of(out.back(), numbers[i]) = given[(k + i) % given.size()];
    }
  }
  for (std::size_t k = 1; k <= kSpread; ++k) {
    out.push_back(spec);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const model::Parameter& parameter = parameter_of(spec, numbers[i]);
      const double low = to_search(parameter, parameter.lower), high = to_search(parameter, parameter.upper);
      const double share = radical_inverse(k + i / kPrimes.size(), kPrimes[i % kPrimes.size()]);
      value_of(out.back(), numbers[i]) = from_search(parameter, low + share * (high - low));
    }
  }
  return out;
}

}  // namespace

NoiseModel plain(const NoiseModel& noise) {
  return {noise.white_N, 0.0, 1.0};
}

Fit fit_from_many_starts(const Problem& problem, const model::ModelSpec& spec, unsigned threads) {
  constexpr int kFew = 6, kMany = 40;
  constexpr std::size_t kFinalists = 4;
  std::vector<model::ModelSpec> starts = starts_of(spec, free_parameters(spec));
  std::vector<Fit> fits(starts.size());
  base::parallel_for(starts.size(), threads, [&](std::size_t i) { fits[i] = problem.fit(std::move(starts[i]), kFew); });
  std::ranges::stable_sort(fits, {}, &Fit::chi2);
  fits.resize(std::min(fits.size(), kFinalists));
  base::parallel_for(fits.size(), threads, [&](std::size_t i) { fits[i] = problem.fit(fits[i].spec, kMany); });
  return *std::ranges::min_element(fits, {}, &Fit::chi2);
}

double squares_of(const Problem& problem, const model::ModelSpec& spec) {
  RowMatrix residual = problem.target() - problem.predict(spec);
  (void)whiten(problem.series(), problem.noise(), residual);
  return residual.squaredNorm();
}

}  // namespace isorig::identify
