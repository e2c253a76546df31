#include "identify/pooling/evidence.hpp"

#include <algorithm>
#include <cmath>

#include "identify/pooling/scale_grid.hpp"

namespace isorig::identify::pooling {
namespace {

double log_odds(double probability) {
  return std::log(probability) - std::log1p(-probability);
}

/// What n that are misread alike count as.
double counted(std::size_t n) {
  const auto all = static_cast<double>(n);
  return n == 0 ? 0.0 : all / (1.0 + (all - 1.0) * kAlike);
}

/// ln(share exp(log_ratio) + 1 - share) of a share given as ln(share) and ln(1 - share).
double log_mixed(double log_share, double log_rest, double log_ratio) {
  const double a = log_share + log_ratio, most = std::max(a, log_rest);
  return most + std::log1p(std::exp(std::min(a, log_rest) - most));
}

/// ln of the integral over the share of an actuator's recordings that show the effect.
double log_ratio_of_actuator(const std::vector<double>& log_ratios, bool event) {
  if (log_ratios.empty()) return 0.0;
  constexpr int kNodes = 400;
  std::vector<double> parts;
  for (int i = 0; i < kNodes; ++i) {
    const double q = (i + 0.5) / kNodes;
    double sum = event ? 0.0 : std::log(2.0 * q);
    for (const double ratio : log_ratios) sum += log_mixed(std::log(q), std::log1p(-q), ratio);
    parts.push_back(sum - std::log(static_cast<double>(kNodes)));
  }
  return log_sum(parts);
}

/// Nodes of the share of actuators, even in its log odds: the prior's mass lies near nought and near one.
struct ShareGrid {
  std::vector<double> log_share, log_rest, log_weight;

  explicit ShareGrid(double mean) {
    constexpr double kWorth = 2.0;  // actuators that the prior counts as
    constexpr double kEnd = 250.0, kStep = 0.25;
    const double a = kWorth * mean, b = kWorth * (1.0 - mean);
    for (double t = -kEnd; t <= kEnd; t += kStep) {
      log_share.push_back(-std::log1p(std::exp(-t)));
      log_rest.push_back(-std::log1p(std::exp(t)));
      log_weight.push_back(a * log_share.back() + b * log_rest.back());
    }
  }
};

void add_share(Presence& out, const ShareGrid& grid, const std::vector<double>& log_posterior, double total) {
  double first = 0.0, second = 0.0, so_far = 0.0;
  out.share.low95 = out.share.high95 = std::nan("");
  for (std::size_t t = 0; t < log_posterior.size(); ++t) {
    const double weight = std::exp(log_posterior[t] - total), share = std::exp(grid.log_share[t]);
    first += weight * share;
    second += weight * share * share;
    so_far += weight;
    if (std::isnan(out.share.low95) && so_far >= 0.025) out.share.low95 = share;
    if (std::isnan(out.share.high95) && so_far >= 0.975) out.share.high95 = share;
  }
  out.share.value = first;
  out.share.standard_error = std::sqrt(std::max(second - first * first, 0.0));
}

}  // namespace

std::size_t Presence::present() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(actuators, [](const Actuator& a) { return a.judged > 0 && a.probability > 0.5; }));
}
std::size_t Presence::judged() const {
  return static_cast<std::size_t>(std::ranges::count_if(actuators, [](const Actuator& a) { return a.judged > 0; }));
}

Presence pool_presence(std::span<const EffectEvidence> evidence, std::size_t actuators, const EffectPriors& priors) {
  const double most = log_odds(kSurest) - priors.log_odds, least = std::log(1.0 - kSurest);
  const auto ratio_of = [&](const EffectEvidence& one) {
    if (one.says == Says::kNotNamed) return std::log(kMissed);
    return std::clamp(log_odds(std::clamp(one.probability, 1e-9, kSurest)) - priors.log_odds, least, most);
  };
  const auto is_weak = [&](const EffectEvidence& one) {
    return one.says == Says::kProbable && one.probability <= 0.5 && ratio_of(one) > 0.0;
  };
  const auto weak = static_cast<std::size_t>(std::ranges::count_if(evidence, is_weak));
  const double power = weak == 0 ? 1.0 : counted(weak) / static_cast<double>(weak);

  Presence out;
  out.actuators.resize(actuators);
  std::vector<std::vector<double>> ratios(actuators);
  std::vector<double> refused(actuators, -INFINITY);
  for (const EffectEvidence& one : evidence) {
    auto& actuator = out.actuators.at(one.actuator);
    if (one.says == Says::kNothing) {
      ++actuator.unjudged;
      continue;
    }
    ++actuator.judged;
    if (one.probability > 0.5) ++actuator.named;
    // The law is wrong in all of them alike: they count once.
    if (one.says == Says::kRefused)
      refused[one.actuator] = std::max(refused[one.actuator], ratio_of(one));
    else
      ratios[one.actuator].push_back(ratio_of(one) * (is_weak(one) ? power : 1.0));
  }
  for (std::size_t i = 0; i < actuators; ++i) {
    if (std::isfinite(refused[i])) ratios[i].push_back(refused[i]);
    auto& actuator = out.actuators[i];
    const std::size_t against = actuator.judged - actuator.named;
    actuator.log_likelihood_ratio =
        std::clamp(log_ratio_of_actuator(ratios[i], priors.event), least * std::max(counted(against), 1.0),
                   most * std::max(counted(actuator.named), 1.0));
  }

  const ShareGrid grid(1.0 / (1.0 + std::exp(-priors.log_odds)));
  std::vector<double> log_posterior = grid.log_weight, log_none = grid.log_weight;
  for (std::size_t t = 0; t < log_posterior.size(); ++t)
    for (const auto& actuator : out.actuators) {
      log_posterior[t] += log_mixed(grid.log_share[t], grid.log_rest[t], actuator.log_likelihood_ratio);
      log_none[t] += grid.log_rest[t];
    }
  const double total = log_sum(log_posterior);
  for (auto& actuator : out.actuators) {
    std::vector<double> parts;
    for (std::size_t t = 0; t < log_posterior.size(); ++t)
      parts.push_back(log_posterior[t] + grid.log_share[t] + actuator.log_likelihood_ratio -
                      log_mixed(grid.log_share[t], grid.log_rest[t], actuator.log_likelihood_ratio));
    actuator.probability = kSurest * std::min(std::exp(log_sum(parts) - total), 1.0);
  }
  out.anywhere = kSurest * std::clamp(-std::expm1(log_sum(log_none) - total), 0.0, 1.0);
  add_share(out, grid, log_posterior, total);
  return out;
}

}  // namespace isorig::identify::pooling
