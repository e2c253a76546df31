#pragma once
#include <span>

#include "identify/diagnose/claims.hpp"

namespace isorig::identify {

/// A claim and what it counts: less or more than one where its kind was simulated more or less often than it comes.
struct CountedClaim {
  double promised = 0.0;
  bool right = false;
  double counts = 1.0;
};

/// Mean and central 95 % interval of c, given claims that promised q_i, each right with the probability c q_i:
///
///     p(c | claims) ~ prod_i (c q_i)^(w_i r_i) (1 - c q_i)^(w_i (1 - r_i)) / sqrt(c (1 - c)),   0 < c < 1
///
/// with r_i = 1 where claim i is right and w_i what it counts. The last factor is the prior of Jeffreys (1946) of a
/// frequency; without claims the mean is one half. Integrated in phi, c = sin^2(phi), where that prior is constant, by
/// the midpoint rule with 4000 points: exact to 1e-6 for up to some thousands of claims.
[[nodiscard]] Sureness sureness_of(std::span<const CountedClaim> claims);

}  // namespace isorig::identify
