#include "identify/diagnose/fit/whiten.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace isorig::identify {

Whitener::Whitener(std::span<const Series> series, const NoiseModel& noise) : coloured_(noise.coloured_N != 0.0) {
  const double white2 = noise.white_N * noise.white_N, coloured2 = noise.coloured_N * noise.coloured_N;
  for (const Series& each : series) {
    double variance = coloured2;
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      double decay = 0.0;
      if (coloured_ && k > 0) {
        decay = std::exp(-noise_dt_s(each, k) / noise.correlation_s);
        variance = variance * decay * decay + coloured2 * (1.0 - decay * decay);
      }
      double gain = 0.0, scale = 0.0;
      if (each.count[k] > 0.0) {
        const double total = variance + white2 / each.count[k];
        gain = variance / total;
        scale = 1.0 / std::sqrt(total);
        variance *= 1.0 - gain;
        sum_log_ += std::log(total);
      }
      decay_.push_back(decay);
      gain_.push_back(gain);
      scale_.push_back(scale);
    }
  }
}

void Whitener::apply(RowMatrix& columns) const {
  const Eigen::Index width = columns.cols();
  if (!coloured_) {
    for (std::size_t row = 0; row < scale_.size(); ++row) {
      double* values = columns.data() + static_cast<Eigen::Index>(row) * width;
      for (Eigen::Index c = 0; c < width; ++c) values[c] *= scale_[row];
    }
    return;
  }
  std::array<double, 48> state{};
  for (std::size_t row = 0; row < scale_.size(); ++row) {
    double* values = columns.data() + static_cast<Eigen::Index>(row) * width;
    const double decay = decay_[row], gain = gain_[row], scale = scale_[row];
    for (Eigen::Index c = 0; c < width; ++c) {
      state[c] *= decay;
      const double innovation = values[c] - state[c];
      state[c] += gain * innovation;
      values[c] = innovation * scale;
    }
  }
}

double whiten(std::span<const Series> series, const NoiseModel& noise, RowMatrix& columns) {
  const Whitener whitener(series, noise);
  whitener.apply(columns);
  return whitener.sum_log();
}

NoiseScore::NoiseScore(std::span<const Series> series, std::span<const double> residual_N) {
  std::size_t row = 0;
  for (const Series& each : series)
    for (std::size_t k = 0; k < each.nodes.size(); ++k, ++row)
      rows_.push_back({k == 0 ? -1.0 : noise_dt_s(each, k), each.count[k], residual_N[row]});
  decay_.resize(rows_.size());
}

double NoiseScore::operator()(const NoiseModel& noise) {
  const double white2 = noise.white_N * noise.white_N, coloured2 = noise.coloured_N * noise.coloured_N;
  if (coloured2 > 0.0 && noise.correlation_s != decay_for_s_) {
    decay_for_s_ = noise.correlation_s;
    for (std::size_t row = 0; row < rows_.size(); ++row)
      decay_[row] = rows_[row].dt_s < 0.0 ? 0.0 : std::exp(-rows_[row].dt_s / noise.correlation_s);
  }
  double variance = coloured2, state = 0.0, squares = 0.0, sum_log = 0.0;
  // One logarithm for every few rows; the product of more could leave the range of a double.
  constexpr int kTogether = 4;
  double product = 1.0;
  int together = 0;
  for (std::size_t row = 0; row < rows_.size(); ++row) {
    const Row& at = rows_[row];
    if (coloured2 > 0.0) {
      const double decay = decay_[row];
      state *= decay;
      variance = variance * decay * decay + coloured2 * (1.0 - decay * decay);
    }
    if (at.count == 0.0) continue;
    const double total = variance + white2 / at.count;
    const double gain = variance / total, innovation = at.residual_N - state;
    state += gain * innovation;
    squares += innovation * innovation / total;
    variance *= 1.0 - gain;
    product *= total;
    if (++together == kTogether) {
      sum_log += std::log(product);
      product = 1.0;
      together = 0;
    }
  }
  sum_log += std::log(product);
  return -0.5 * (squares + sum_log);
}

double NoiseScore::rms_N() const {
  double squares = 0.0, count = 0.0;
  for (const Row& at : rows_) {
    if (at.count == 0.0) continue;
    squares += at.count * at.residual_N * at.residual_N;
    count += 1.0;
  }
  return std::sqrt(squares / count);
}

}  // namespace isorig::identify
