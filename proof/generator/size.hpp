#pragma once
#include <functional>

#include "proof/generator/effects.hpp"

namespace isorig::proof {

/// What an effect leaves after the nominal refit, in noise-free force (residual_size_N of fit/nominal.hpp).
[[nodiscard]] double residual_left_N(const RigParameters& rig, const Motion& train, const Sampling& sampling);

/// The strength at which the effect leaves `target_N`, or its utmost. Found by a few simulations.
[[nodiscard]] double full_strength(const ConcealedEffect& effect, const RigParameters& clean, const Motion& train,
                                   const Sampling& sampling, double target_N);

/// The strength between 0 and `most` at which `left_N(strength)` is the target, within 10 % or five steps.
[[nodiscard]] double strength_leaving(double start, double most, double target_N,
                                      const std::function<double(double)>& left_N);

}  // namespace isorig::proof
