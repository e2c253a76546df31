#pragma once
#include <algorithm>
#include <cmath>

namespace isorig::clock {

/// How a device's rate strays: rate(t) is an Ornstein-Uhlenbeck process of standard deviation `rate_ppm` and
/// correlation time `correlation_s`, the usual model of a crystal in a room. The defaults are a pessimistic
/// microcontroller crystal. Valid for any time span; a thermal shock beyond it shows as an inconsistent map.
struct Wander {
  double rate_ppm = 1.0;
  double correlation_s = 600.0;

  /// Growth of the rate's variance, ppm^2 per s, over spans much shorter than the correlation time.
  [[nodiscard]] double diffusion_ppm2_per_s() const noexcept { return 2.0 * rate_ppm * rate_ppm / correlation_s; }

  /// Standard deviation, in us, of the departure from the tangent `seconds` away:
  ///   D(s) = integral_0^s (x(u) - x(0)) du,   z = |s| / T,
  ///   Var D = sigma^2 T^2 [2 (z - 1 + e^-z) + z^2 - 2 z (1 - e^-z)]  <=  (2 sigma^2 / T) |s|^3 / 3.
  /// A straight line is a good map for a minute (15 us at 60 s) and a poor one for five (158 us at 300 s).
  [[nodiscard]] double departure_us(double seconds) const noexcept {
    const double z = std::abs(seconds) / correlation_s;
    if (z < 0.01) return largest_departure_us(seconds);  // the difference below would cancel
    const double decayed = -std::expm1(-z);
    const double variance = 2.0 * (z - decayed) + z * z - 2.0 * z * decayed;
    return rate_ppm * correlation_s * std::sqrt(std::max(variance, 0.0));
  }
  /// The upper limit above, without an exponential: for the real-time loop.
  [[nodiscard]] double largest_departure_us(double seconds) const noexcept {
    const double s = std::abs(seconds);
    return s * std::sqrt(diffusion_ppm2_per_s() * s / 3.0);
  }
};

}  // namespace isorig::clock
