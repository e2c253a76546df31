#include "identify/diagnose/noise/noise_likelihood.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/noise_search.hpp"

namespace isorig::identify {

// With y the force of a sample, X its columns and V the covariance of the noise (constants left out)
//
//     ln L = -1/2 sum over samples [ ln|V| + ln|A| + y'V^-1 y - b'A^-1 b ],   A = X'V^-1 X,  b = X'V^-1 y
//
// (Patterson & Thompson 1971). V is never formed: a Kalman filter of the coloured state runs over X and y
// alike, its innovations e_k have variance S_k (whiten.hpp), and so ln|V| = sum ln S_k and the Gram matrix of [X y]
// under V^-1 is sum e_k e_k' / S_k.
double noise_likelihood(std::span<const NoiseSample> samples, const NoiseModel& noise) {
  constexpr int kColumns = NoiseSample::kMostColumns;
  using Vector = Eigen::Matrix<double, kColumns + 1, 1>;
  double sum = 0.0;
  const double stationary = noise.coloured_N * noise.coloured_N, white2 = noise.white_N * noise.white_N;
  for (const NoiseSample& sample : samples) {
    Vector mean = Vector::Zero();
    Eigen::Matrix<double, kColumns + 1, kColumns + 1> gram = Eigen::Matrix<double, kColumns + 1, kColumns + 1>::Zero();
    double variance = stationary;
    for (std::size_t k = 0; k < sample.size(); ++k) {
      if (k > 0 && stationary > 0.0) {
        const double decay = std::exp(-(sample.t_s[k] - sample.t_s[k - 1]) / noise.correlation_s);
        mean *= decay;
        variance = variance * decay * decay + stationary * (1.0 - decay * decay);
      }
      const double white2_here = white2 / sample.readings[k];
      const double total = variance + white2_here;
      Vector e;
      for (int c = 0; c < kColumns; ++c) e[c] = sample.columns[k][static_cast<std::size_t>(c)];
      e[kColumns] = sample.force_N[k] - sample.force_N[0];
      e -= mean;
      gram += e * e.transpose() / total;
      sum -= 0.5 * std::log(total);
      mean += variance / total * e;
      variance *= white2_here / total;
    }
    Eigen::Matrix<double, kColumns, kColumns> a = gram.topLeftCorner<kColumns, kColumns>();
    const Eigen::Matrix<double, kColumns, 1> b = gram.topRightCorner<kColumns, 1>();
    for (int c = 0; c < kColumns; ++c)
      if (a(c, c) == 0.0) a(c, c) = 1.0;  // a column that is not used takes nothing along
    sum -= 0.5 * (gram(kColumns, kColumns) - b.dot(a.ldlt().solve(b)) + std::log(a.determinant()));
  }
  return sum;
}

// One number: a step up or down by the factor exp(width), narrower each time; the likelihood of a single variance has
// one maximum.
NoiseModel fit_white_noise(std::span<const NoiseSample> samples, double start_N) {
  NoiseModel best{start_N, 0.0, 1.0};
  double best_score = noise_likelihood(samples, best);
  for (double width = 1.0; width > 0.002; width *= 0.6) {
    for (const double direction : {1.0, -1.0}) {
      const NoiseModel trial{best.white_N * std::exp(direction * width), 0.0, 1.0};
      if (const double s = noise_likelihood(samples, trial); s > best_score) {
        best_score = s;
        best = trial;
      }
    }
  }
  return best;
}

namespace {

struct BestNoise {
  NoiseModel white, either;  ///< `either`: with a coloured part, where any is likelier than none
  double log_likelihood_white = 0.0, log_likelihood = 0.0;
};

BestNoise best_noise(std::span<const NoiseSample> samples, double start_N, double longest_s) {
  BestNoise out;
  out.white = out.either = fit_white_noise(samples, start_N);
  out.log_likelihood_white = out.log_likelihood = noise_likelihood(samples, out.white);
  const double all = out.white.white_N;
  for (const double correlation : {0.05, 0.3, 1.0, 3.0, 8.0}) {
    for (const double share : {0.15, 0.4, 0.8}) {
      const NoiseModel trial{all * std::sqrt(1.0 - share * share), share * all, std::min(correlation, longest_s)};
      if (const double s = noise_likelihood(samples, trial); s > out.log_likelihood) {
        out.log_likelihood = s;
        out.either = trial;
      }
    }
  }
  // Not along the ridge: in rests it is flat, since the columns take up whatever lasts, and its top is at longest_s.
  climb(out.either, out.log_likelihood,
        {.width = {0.1, 0.5, 0.6, 0.0}, .passes = 12, .shortest_s = 0.01, .longest_s = longest_s},
        [&](const NoiseModel& noise) { return noise_likelihood(samples, noise); });
  return out;
}

}  // namespace

NoiseModel fit_noise(std::span<const NoiseSample> samples, double start_N, double longest_s) {
  std::size_t rows = 0;
  for (const NoiseSample& sample : samples) rows += sample.size();
  const BestNoise best = best_noise(samples, start_N, longest_s);
  // Two numbers more than white noise, half a log of the rows each (Schwarz 1978).
  const double price = deciding().coloured_noise_numbers * deciding().numbers_cost_log_rows;
  const bool earned = best.log_likelihood - best.log_likelihood_white >= price * std::log(static_cast<double>(rows));
  return earned ? best.either : NoiseModel{best.white.white_N, 0.0, 1.0};
}

double log_likelihood_lost(std::span<const NoiseSample> samples, const NoiseModel& noise, double longest_s) {
  const BestNoise best = best_noise(samples, noise.white_N, longest_s);
  return std::max(best.log_likelihood - noise_likelihood(samples, noise), 0.0);
}

}  // namespace isorig::identify
