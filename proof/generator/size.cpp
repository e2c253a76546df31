#include "proof/generator/size.hpp"

#include <algorithm>
#include <cmath>

#include "proof/fit/nominal.hpp"

namespace isorig::proof {
namespace {
// Coarser than what is recorded; a strength found to some per cent is found.
constexpr double kSizingStep_s = 1e-3;
}  // namespace

double residual_left_N(const RigParameters& rig, const Motion& train, const Sampling& sampling) {
  const Trace trace = simulate(rig, train, sampling, {}, kSizingStep_s);
  const NominalFit fit =
      fit_nominal(trace.t_s, trace.position_mm, trace.force_N, static_cast<int>(rig.specimen.arms.size()));
  return residual_size_N(fit, dense_rows(trace.t_s));
}

double strength_leaving(double start, double most, double target_N, const std::function<double(double)>& left_N) {
  const auto left_at = [&left_N](double strength) { return std::fmax(left_N(strength), 1e-6); };
  // Secant steps between logarithms: most effects leave a power of their strength.
  double strength = start;
  double left = left_at(strength);
  double slope = 1.0;
  for (int round = 0; round < 5 && std::abs(std::log(left / target_N)) > 0.1; ++round) {
    const double move = std::clamp(std::log(target_N / left) / slope, -2.5, 2.5);
    const double next = std::min(strength * std::exp(move), most);
    if (next == strength) break;  // at its utmost
    const double next_left = left_at(next);
    const double seen = std::log(next_left / left) / std::log(next / strength);
    slope = std::clamp(std::isfinite(seen) ? seen : 1.0, 0.5, 3.0);
    strength = next;
    left = next_left;
  }
  return strength;
}

double full_strength(const ConcealedEffect& effect, const RigParameters& clean, const Motion& train,
                     const Sampling& sampling, double target_N) {
  return strength_leaving(effect.strength, effect_kind(effect.name).most, target_N, [&](double strength) {
    RigParameters rig = clean;
    ConcealedEffect trial = effect;
    trial.strength = strength;
    conceal(trial, rig);
    return residual_left_N(rig, train, sampling);
  });
}

}  // namespace isorig::proof
