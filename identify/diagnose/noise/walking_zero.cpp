#include "identify/diagnose/noise/walking_zero.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/noise_search.hpp"

namespace isorig::identify {
namespace {

constexpr std::ptrdiff_t kFewestAtRest = 8;
constexpr std::size_t kFewestLongBlocks = 12;

struct Block {
  double number = 0.0;
  double readings = 0.0;
  double residual_N = 0.0;  ///< mean
  bool at_rest = true;      ///< from its beginning to its end, and for as long before
};

struct Rates {
  double white_N = 0.0;
  double common_N = 0.0;  ///< of all readings of a block alike
  double rest_N2_s = 0.0;
  double motion_N2_s = 0.0;
};

std::vector<Block> blocks_of(const Series& series, const Eigen::VectorXd& residual_N, double length_s) {
  std::vector<Block> blocks;
  const double still_mm_s = identify::still_mm_s(series);
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const double readings = series.count[k], t_s = series.nodes[k].t_s;
    if (readings <= 0.0) continue;
    const double number = std::floor((t_s - series.nodes.front().t_s) / length_s);
    if (blocks.empty() || blocks.back().number != number) blocks.push_back({.number = number});
    Block& block = blocks.back();
    const bool still = std::fabs(series.nodes[k].velocity_mm_s) < still_mm_s && series.since_corner_s[k] > length_s;
    block.at_rest = block.at_rest && still;
    block.residual_N += readings * residual_N[static_cast<Eigen::Index>(k)];
    block.readings += readings;
  }
  for (Block& block : blocks) {
    block.residual_N /= block.readings;
  }
  return blocks;
}

double log_likelihood(const std::vector<Block>& blocks, double length_s, const Rates& rates) {
  double state_N = 0.0, variance = 0.0, sum = 0.0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const Block& now = blocks[b];
    const double own = rates.white_N * rates.white_N / now.readings + rates.common_N * rates.common_N;
    const double steps = (now.at_rest ? rates.rest_N2_s : rates.motion_N2_s) * length_s;
    if (b == 0) {
      state_N = now.residual_N;
      variance = own + steps / 3.0;
      continue;
    }
    // No readings came, or bins at rest are wider than blocks.
    const double between = now.at_rest && blocks[b - 1].at_rest ? rates.rest_N2_s : rates.motion_N2_s;
    variance += between * (now.number - blocks[b - 1].number - 1.0) * length_s;
    const double total = variance + steps / 3.0 + own, with_mean = variance + steps / 2.0;
    const double innovation_N = now.residual_N - state_N;
    sum -= 0.5 * (std::log(total) + innovation_N * innovation_N / total);
    state_N += with_mean / total * innovation_N;
    variance += steps - with_mean * with_mean / total;
  }
  return sum;
}

enum class At { kOneRate, kTwoRates, kStillAtRest };

struct Likeliest {
  Rates rates;
  double log_likelihood = 0.0;
};

Likeliest likeliest(const std::vector<Block>& blocks, double length_s, Rates from, At at) {
  constexpr int kPasses = 16;
  constexpr std::array kWidth{0.5, 1.5, 1.5, 1.5};
  if (at == At::kStillAtRest) from.rest_N2_s = 0.0;
  Likeliest out{from, log_likelihood(blocks, length_s, from)};
  const auto move = [at](Rates& rates, std::size_t i, double factor) {
    if (i == 0) rates.white_N *= factor;
    if (i == 1) rates.common_N *= factor;
    if (i == 2) rates.motion_N2_s *= factor;
    if (i == 2 && at == At::kOneRate) rates.rest_N2_s *= factor;
    if (i == 3) rates.rest_N2_s *= factor;
    return i < 3 || at == At::kTwoRates;
  };
  climb(out.rates, out.log_likelihood, kWidth, kPasses, move,
        [&](const Rates& rates) { return log_likelihood(blocks, length_s, rates); });
  return out;
}

/// Mean square of the change from block to block over the time between: a rate to begin with.
double first_rate_N2_s(const std::vector<Block>& blocks, double length_s) {
  double squares_N2 = 0.0;
  for (std::size_t b = 1; b < blocks.size(); ++b)
    squares_N2 += std::pow(blocks[b].residual_N - blocks[b - 1].residual_N, 2.0);
  return squares_N2 / ((blocks.back().number - blocks.front().number) * length_s);
}

/// Without what the level and the first six cosines over the recording follow, by least squares.
std::vector<Block> without_slow_part(std::vector<Block> blocks) {
  constexpr Eigen::Index kCosines = 6;
  const auto count = static_cast<Eigen::Index>(blocks.size());
  Eigen::MatrixXd columns(count, kCosines + 1);
  Eigen::VectorXd left_N(count);
  const double begin = blocks.front().number, lasts = blocks.back().number - begin;
  for (Eigen::Index b = 0; b < count; ++b) {
    const Block& block = blocks[static_cast<std::size_t>(b)];
    for (Eigen::Index k = 0; k <= kCosines; ++k)
      columns(b, k) = std::cos(std::numbers::pi * static_cast<double>(k) * (block.number - begin) / lasts);
    left_N[b] = block.residual_N;
  }
  left_N -= columns * columns.colPivHouseholderQr().solve(left_N);
  for (Eigen::Index b = 0; b < count; ++b) blocks[static_cast<std::size_t>(b)].residual_N = left_N[b];
  return blocks;
}

}  // namespace

double WalkingZero::rms_N(double over_s) const noexcept {
  return std::sqrt(rate_N2_s * over_s);
}

bool is_walk(const NoiseModel& noise, std::span<const Series> series) noexcept {
  return noise.coloured_N > 0.0 && std::ranges::all_of(series, [&](const Series& each) {
           return noise.correlation_s > each.nodes.back().t_s - each.nodes.front().t_s;
         });
}

std::optional<WalkingZero> walking_zero(const Series& series, const Eigen::VectorXd& residual_N, double white_N) {
  constexpr double kLonger = 4.0;
  const double length_s = deciding().walk_block_rests * series.rest_s;
  const std::vector<Block> blocks = blocks_of(series, residual_N, length_s);
  if (std::ranges::count(blocks, true, &Block::at_rest) < kFewestAtRest) return std::nullopt;
  const double rate_N2_s = first_rate_N2_s(blocks, length_s);
  if (!(rate_N2_s > 0.0)) return std::nullopt;
  const Rates first{white_N, 0.1 * white_N, rate_N2_s, rate_N2_s};
  const Likeliest one = likeliest(blocks, length_s, first, At::kOneRate);
  const Likeliest two = likeliest(blocks, length_s, one.rates, At::kTwoRates);
  if (two.log_likelihood - one.log_likelihood > deciding().allowed_noise_log) return std::nullopt;
  // A zero that stands still at rest is compared at its best: what is not its noise may be common to a block.
  Likeliest still = likeliest(blocks, length_s, two.rates, At::kStillAtRest);
  for (const double share : {0.1, 0.5, 1.0}) {
    Rates noisier = two.rates;
    noisier.common_N = std::max(noisier.common_N, std::sqrt(share * two.rates.rest_N2_s * length_s));
    if (Likeliest other = likeliest(blocks, length_s, noisier, At::kStillAtRest);
        other.log_likelihood > still.log_likelihood)
      still = other;
  }
  const double price = deciding().numbers_cost_log_rows * std::log(static_cast<double>(blocks.size()));
  const WalkingZero out{.rate_N2_s = one.rates.motion_N2_s,
                        .log_odds_nats = two.log_likelihood - still.log_likelihood - price,
                        .rest_rate_N2_s = two.rates.rest_N2_s,
                        .motion_rate_N2_s = two.rates.motion_N2_s};
  if (out.log_odds_nats <= 0.0) return std::nullopt;
  const auto keeps_its_rate = [&](const std::vector<Block>& of, double long_s) {
    const double times = likeliest(of, long_s, one.rates, At::kOneRate).rates.motion_N2_s / out.rate_N2_s;
    return times < deciding().walk_growth_ratio && times > 1.0 / deciding().walk_growth_ratio;
  };
  const std::vector<Block> longer = blocks_of(series, residual_N, kLonger * length_s);
  if (longer.size() < kFewestLongBlocks || !keeps_its_rate(longer, kLonger * length_s) ||
      !keeps_its_rate(without_slow_part(blocks), length_s))
    return std::nullopt;
  return out;
}

}  // namespace isorig::identify
