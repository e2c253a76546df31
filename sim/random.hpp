#pragma once
#include <bit>
#include <cmath>
#include <cstdint>

namespace isorig::sim {

/// xoshiro256++ (Blackman and Vigna 2019), seeded by splitmix64. Our own, because the distributions of
/// the standard library differ between library versions and a recording must be reproducible from its seed. Every noise
/// source has a stream of its own (`stream`), so that switching one off leaves the others as they were.
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream) noexcept {
    std::uint64_t x = seed ^ (stream * 0x9E3779B97F4A7C15ULL + 0xD1B54A32D192ED03ULL);
    for (auto& s : state_) {
      x += 0x9E3779B97F4A7C15ULL;
      std::uint64_t z = x;
      z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
      z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
      s = z ^ (z >> 31);
    }
  }

  std::uint64_t bits() noexcept {
    const std::uint64_t result = std::rotl(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = std::rotl(state_[3], 45);
    return result;
  }

  /// Uniform on [0, 1), 53 bits.
  double uniform() noexcept { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }
  /// Exponential, mean 1.
  double exponential() noexcept { return -std::log1p(-uniform()); }

  /// Standard normal: ziggurat of 128 layers (Marsaglia and Tsang 2000 in Doornik's corrected form: layer and
  /// abscissa come from different bits). One draw and one multiplication in 98.8 % of the calls.
  double normal() noexcept {
    const std::uint64_t u = bits();
    const unsigned layer = static_cast<unsigned>(u & 0x7F);
    const double x = static_cast<double>(static_cast<std::int64_t>(u) >> 11) * 0x1.0p-52;  // [-1, 1)
    if (std::abs(x) < kZiggurat.ratio[layer]) [[likely]]
      return x * kZiggurat.edge[layer];
    return normal_slow(x, layer);
  }

 private:
  struct Ziggurat {
    Ziggurat() noexcept;
    double edge[129];
    double ratio[128];
  };
  static const Ziggurat kZiggurat;
  double normal_slow(double x, unsigned layer) noexcept;

  std::uint64_t state_[4];
};

/// Rounds to the nearest multiple, ties to even, without a library call; |value / quantum| < 2^51.
inline double quantise(double value, double quantum, double inverse_quantum) noexcept {
  constexpr double kMagic = 0x1.8p52;
  return ((value * inverse_quantum + kMagic) - kMagic) * quantum;
}

}  // namespace isorig::sim
