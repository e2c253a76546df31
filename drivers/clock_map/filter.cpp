#include "drivers/clock_map/filter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/quantile.hpp"

namespace isorig::clock {
namespace {

constexpr double kRatePriorPpm = 100.0;  // crystals: +-100 ppm at the very worst, here one sigma
constexpr double kTailMemory = 0.005;    // some 200 exchanges
constexpr double kLeastTail_us = 0.1;
/// The base delay may creep: 6 us in a quarter of an hour, so that a path that became slower is believed in
/// time.
constexpr double kBaseDiffusion_us2_per_s = 0.04;

/// Multiplies the state by the likelihood exp(z / tail) [z <= limit] of z = weights . mean, and keeps the
/// moments.
void observe_below(FilterState& state, const Eigen::Vector3d& weights, double limit, double tail) noexcept {
  const Eigen::Vector3d spread = state.covariance * weights;
  const double variance = weights.dot(spread);
  if (!(variance > 0.0)) return;
  const double sd = std::sqrt(variance);
  const double before = weights.dot(state.mean);
  const double shifted = before + variance / tail;
  const double a = (limit - shifted) / sd;
  double mean = 0.0, left = 0.0;
  if (a < -6.0) {
    // Far in the tail the cut Gaussian is an exponential below the limit; the ratio below would lose its
    // digits.
    const double inverse = 1.0 / (a * a);
    mean = limit + sd / a * (1.0 - 2.0 * inverse);
    left = variance * inverse * (1.0 - 6.0 * inverse);
  } else {
    const double density = std::exp(-0.5 * a * a) / std::sqrt(2.0 * std::numbers::pi);
    const double ratio = density / (0.5 * std::erfc(-a / std::numbers::sqrt2));
    mean = shifted - sd * ratio;
    left = variance * (1.0 - a * ratio - ratio * ratio);
  }
  const Eigen::Vector3d gain = spread / variance;
  state.mean += gain * (mean - before);
  state.covariance += gain * gain.transpose() * (left - variance);
}

void learn_tail(double& tail, double excess, double share) noexcept {
  tail = std::max(tail + share * (std::clamp(excess, 0.0, 5.0 * tail) - tail), kLeastTail_us);
}

}  // namespace

FilterState predicted(FilterState state, double device_s, const Wander& wander) noexcept {
  const double s = device_s - state.device_s;
  const double span = std::abs(s), q = wander.diffusion_ppm2_per_s();
  state.device_s = device_s;
  state.mean[0] += s * state.mean[1];
  auto& p = state.covariance;
  p.row(0) += s * p.row(1);
  p.col(0) += s * p.col(1);
  p(0, 0) += q * span * span * span / 3.0;
  p(0, 1) += q * s * span / 2.0;
  p(1, 0) = p(0, 1);
  p(1, 1) += q * span;
  p(2, 2) += kBaseDiffusion_us2_per_s * span;
  return state;
}

void DelayFilter::add(const Interval& exchange) noexcept {
  if (count_ < kSettling) {
    first_[count_++] = exchange;
    settle();
    return;
  }
  ++count_;
  observe(exchange, kTailMemory);
}

// The filter needs a prior and a first idea of the tails, and what the first exchange suggests may be far
// off. So while there are few, all of them are gone through again with what all of them say.
void DelayFilter::settle() noexcept {
  const auto round_trip = [](const Interval& i) { return std::max(i.high_us - i.low_us, 1.0); };
  std::array<double, kSettling> trips{};
  const Interval* best = &first_[0];
  for (std::size_t i = 0; i < count_; ++i) {
    trips[i] = round_trip(first_[i]);
    if (trips[i] < round_trip(*best)) best = &first_[i];
  }
  const double median = base::quantile_in_place(std::span(trips).first(count_), 0.5);
  const double least = round_trip(*best);
  // Two exponential delays together have a median of 1.678 tails; one exchange alone says nothing.
  const double share = static_cast<double>(count_ - 1) / static_cast<double>(count_ + 4);
  const double tail = share * (median - least) / 1.678 + (1.0 - share) * 0.25 * least;
  tail_high_us_ = tail_low_us_ = std::max(tail, kLeastTail_us);

  const double away_s = best->high_seconds - first_[0].low_seconds;
  const double sd_us = 0.5 * least + kRatePriorPpm * std::abs(away_s);
  begin(*best, first_[0].low_seconds, sd_us, 0.25 * least);
  if (count_ == 1) return;  // its midpoint is all there is
  for (std::size_t i = 0; i < count_; ++i) observe(first_[i], 1.0 / (20.0 + static_cast<double>(i)));
}

void DelayFilter::begin(const Interval& around, double device_s, double sd_us, double base_us) noexcept {
  state_.device_s = device_s;
  state_.mean = {0.5 * (around.high_us + around.low_us), 0.0, base_us};
  state_.covariance = Eigen::Vector3d(sd_us * sd_us, kRatePriorPpm * kRatePriorPpm, base_us * base_us).asDiagonal();
}

void DelayFilter::observe(const Interval& exchange, double tail_share) noexcept {
  state_ = predicted(state_, exchange.low_seconds, wander_);
  const double low_excess = state_.mean[0] - state_.mean[2] - exchange.low_us;
  observe_below(state_, {-1.0, 0.0, 1.0}, -exchange.low_us, tail_low_us_);
  state_ = predicted(state_, exchange.high_seconds, wander_);
  const double high_excess = exchange.high_us - state_.mean[0] - state_.mean[2];
  observe_below(state_, {1.0, 0.0, 1.0}, exchange.high_us, tail_high_us_);
  learn_tail(tail_low_us_, low_excess, tail_share);
  learn_tail(tail_high_us_, high_excess, tail_share);
}

}  // namespace isorig::clock
