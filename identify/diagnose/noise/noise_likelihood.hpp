#pragma once
#include <array>
#include <span>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// A stretch of readings that is noise once a few smooth columns have been taken out of it.
struct NoiseSample {
  static constexpr std::size_t kMostColumns = 6;
  std::vector<double> t_s;
  std::vector<double> force_N;
  std::vector<double> readings;  ///< that each value stands for: its white variance is white^2 / readings
  std::vector<std::array<double, kMostColumns>> columns;

  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

/// Restricted log-likelihood (Patterson & Thompson 1971): the columns are integrated out of every sample, so
/// that they take no noise along and what they stand for does not pass for coloured noise.
[[nodiscard]] double noise_likelihood(std::span<const NoiseSample> samples, const NoiseModel& noise);

/// White noise of the samples by restricted likelihood, from `start_N` on.
[[nodiscard]] NoiseModel fit_white_noise(std::span<const NoiseSample> samples, double start_N);
/// White and Ornstein-Uhlenbeck noise; the coloured part only where its two numbers earn half a log of the rows each.
/// A correlation longer than `longest_s` cannot be told from the columns.
[[nodiscard]] NoiseModel fit_noise(std::span<const NoiseSample> samples, double start_N, double longest_s);
/// By how much the log-likelihood of the samples is less under `noise` than under the noise that suits them best, with
/// a coloured part whether it earns its numbers or not. Not negative.
[[nodiscard]] double log_likelihood_lost(std::span<const NoiseSample> samples, const NoiseModel& noise,
                                         double longest_s);

}  // namespace isorig::identify
