#pragma once
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "drivers/api/clock.hpp"

namespace isorig::bench {

/// A device clock and the exchanges with it, whose truth is known. Times in seconds of host time.
struct ClockScenario {
  double duration_s = 3600.0;
  double skew_ppm = 30.0;
  double wander_ppm = 1.0;
  double wander_correlation_s = 600.0;
  double request_base_us = 250.0, request_tail_us = 300.0;
  double reply_base_us = 250.0, reply_tail_us = 300.0;
  double spike_us = 5000.0, spike_probability = 0.01;
  double turnaround_us = 20.0;
  double exchange_period_s = 1.0;
  int burst = 50;  ///< exchanges before time 0
  double burst_period_s = 0.02;
  double stamp_period_s = 0.1;
  bool uniform_tails = false;         ///< of the same mean instead of exponential: not what the filter assumes
  double device_resolution_us = 0.0;  ///< stamps are rounded down to this
};

inline ClockScenario scenario_a() {
  return {};
}
/// Tails differ: no method should care.
inline ClockScenario scenario_b() {
  ClockScenario s;
  s.request_tail_us = 100.0;
  s.reply_tail_us = 500.0;
  return s;
}
/// Base delays differ: 0.1 ms that no software can see, and that the bound has to cover.
inline ClockScenario scenario_c() {
  ClockScenario s;
  s.request_base_us = 150.0;
  s.reply_base_us = 350.0;
  return s;
}

struct ClockTruth {
  std::vector<clock::Exchange> exchanges;  ///< in the order of their replies
  struct Stamp {
    double device_us;      ///< the device's own stamp
    std::int64_t true_ns;  ///< host time at that instant
    std::int64_t arrival_ns;
  };
  std::vector<Stamp> stamps;
};

/// Same seed, same result, on every platform whose libstdc++ draws the same numbers.
class ClockSimulation {
 public:
  ClockSimulation(const ClockScenario& scenario, unsigned seed) : s_(scenario), random_(seed) {
    const double lead_s = 10.0 + s_.burst * s_.burst_period_s;
    const auto steps = static_cast<std::size_t>((s_.duration_s + lead_s + 20.0) / kStep);
    std::normal_distribution<double> normal;
    const double keep = std::exp(-kStep / s_.wander_correlation_s);
    const double kick = s_.wander_ppm * std::sqrt(1.0 - keep * keep);
    double rate_ppm = s_.wander_ppm * normal(random_);
    excess_us_.reserve(steps + 1);
    excess_us_.push_back(0.0);
    for (std::size_t i = 0; i < steps; ++i) {
      excess_us_.push_back(excess_us_.back() + (s_.skew_ppm + rate_ppm) * kStep);
      rate_ppm = rate_ppm * keep + kick * normal(random_);
    }
    start_s_ = -lead_s;
  }

  ClockTruth run() {
    ClockTruth truth;
    for (int i = s_.burst; i > 0; --i) truth.exchanges.push_back(exchange(-i * s_.burst_period_s));
    std::uniform_real_distribution<double> phase(0.0, 1.0);
    for (double t = 0.0; t < s_.duration_s; t += s_.exchange_period_s) truth.exchanges.push_back(exchange(t));
    for (double t = s_.stamp_period_s * phase(random_); t < s_.duration_s; t += s_.stamp_period_s) {
      truth.stamps.push_back({stamp(t), ns(t), ns(t + 1e-6 * delay(s_.reply_base_us, s_.reply_tail_us))});
    }
    return truth;
  }

  /// The device's clock at host time t, in us.
  double device_us(double t_s) const {
    const double x = (t_s - start_s_) / kStep;
    const auto i = static_cast<std::size_t>(x);
    const double part = x - static_cast<double>(i);
    return (t_s - start_s_) * 1e6 + excess_us_[i] * (1.0 - part) + excess_us_[i + 1] * part;
  }

  clock::Exchange exchange(double t_s) {
    const double rx = t_s + 1e-6 * delay(s_.request_base_us, s_.request_tail_us);
    const double tx = rx + 1e-6 * s_.turnaround_us;
    const double received = tx + 1e-6 * delay(s_.reply_base_us, s_.reply_tail_us);
    return {ns(t_s), ns(received), stamp(rx), stamp(tx)};
  }

  static std::int64_t ns(double t_s) { return kEpoch_ns + static_cast<std::int64_t>(std::llround(t_s * 1e9)); }

 private:
  static constexpr double kStep = 0.1;
  static constexpr std::int64_t kEpoch_ns = 86'400'000'000'000;  // the host has been up for a day

  double delay(double base_us, double tail_us) {
    std::exponential_distribution<double> tail(1.0 / tail_us);
    std::bernoulli_distribution spike(s_.spike_probability);
    std::uniform_real_distribution<double> uniform(0.0, 2.0 * tail_us);
    return base_us + (s_.uniform_tails ? uniform(random_) : tail(random_)) + (spike(random_) ? s_.spike_us : 0.0);
  }
  double stamp(double t_s) const {
    const double us = device_us(t_s);
    return s_.device_resolution_us > 0.0 ? std::floor(us / s_.device_resolution_us) * s_.device_resolution_us : us;
  }

  ClockScenario s_;
  std::mt19937_64 random_;
  std::vector<double> excess_us_;
  double start_s_ = 0.0;
};

}  // namespace isorig::bench
