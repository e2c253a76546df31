#include "sim/random.hpp"

namespace isorig::sim {
namespace {
// 128 layers of equal area: where the tail begins, and the area (Doornik 2005, "An improved ziggurat
// method").
constexpr double kTail = 3.442619855899;
constexpr double kArea = 9.91256303526217e-3;
}  // namespace

Random::Ziggurat::Ziggurat() noexcept {
  double f = std::exp(-0.5 * kTail * kTail);
  edge[0] = kArea / f;
  edge[1] = kTail;
  edge[128] = 0.0;
  for (int i = 2; i < 128; ++i) {
    edge[i] = std::sqrt(-2.0 * std::log(kArea / edge[i - 1] + f));
    f = std::exp(-0.5 * edge[i] * edge[i]);
  }
  for (int i = 0; i < 128; ++i) ratio[i] = edge[i + 1] / edge[i];
}

const Random::Ziggurat Random::kZiggurat;

double Random::normal_slow(double x, unsigned layer) noexcept {
  for (;;) {
    if (layer == 0) {
      for (;;) {  // Marsaglia's tail
        const double a = -std::log1p(-uniform()) / kTail;
        const double b = -std::log1p(-uniform());
        if (2.0 * b > a * a) return x < 0.0 ? -(kTail + a) : kTail + a;
      }
    }
    const double value = x * kZiggurat.edge[layer];
    const double low = std::exp(-0.5 * (kZiggurat.edge[layer] * kZiggurat.edge[layer] - value * value));
    const double high = std::exp(-0.5 * (kZiggurat.edge[layer + 1] * kZiggurat.edge[layer + 1] - value * value));
    if (high + uniform() * (low - high) < 1.0) return value;
    const std::uint64_t u = bits();
    layer = static_cast<unsigned>(u & 0x7F);
    x = static_cast<double>(static_cast<std::int64_t>(u) >> 11) * 0x1.0p-52;
    if (std::abs(x) < kZiggurat.ratio[layer]) return x * kZiggurat.edge[layer];
  }
}

}  // namespace isorig::sim
