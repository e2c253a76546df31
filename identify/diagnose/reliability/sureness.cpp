#include "identify/diagnose/reliability/sureness.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace isorig::identify {
namespace {

double log_likelihood(std::span<const CountedClaim> claims, double c) {
  double sum = 0.0;
  for (const CountedClaim& claim : claims) {
    const double right = std::clamp(c * claim.promised, 1e-300, 1.0);
    sum += claim.counts * (claim.right ? std::log(right) : std::log1p(-std::min(right, 1.0 - 1e-15)));
  }
  return sum;
}

}  // namespace

Sureness sureness_of(std::span<const CountedClaim> claims) {
  constexpr std::size_t kPoints = 4000;
  std::vector<double> c(kPoints), density(kPoints);
  for (std::size_t i = 0; i < kPoints; ++i) {
    const double phi = (static_cast<double>(i) + 0.5) / kPoints * std::numbers::pi / 2.0;
    c[i] = std::sin(phi) * std::sin(phi);
    density[i] = log_likelihood(claims, c[i]);
  }
  const double highest = *std::ranges::max_element(density);
  double whole = 0.0;
  for (double& each : density) whole += each = std::exp(each - highest);
  Sureness out;
  double below = 0.0;
  bool low_found = false, high_found = false;
  for (std::size_t i = 0; i < kPoints; ++i) {
    out.value += c[i] * density[i] / whole;
    below += density[i] / whole;
    if (!low_found && below >= 0.025) {
      out.low95 = c[i];
      low_found = true;
    }
    if (!high_found && below >= 0.975) {
      out.high95 = c[i];
      high_found = true;
    }
  }
  out.claims = claims.size();
  out.right = static_cast<std::size_t>(std::ranges::count(claims, true, &CountedClaim::right));
  return out;
}

}  // namespace isorig::identify
