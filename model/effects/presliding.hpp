#pragma once
#include <cmath>
#include <utility>
#include <vector>

#include "model/process.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {

/// The presliding distance means the same in every law with a Dahl bristle or a Jenkins element.
inline constexpr NumberSheet kPreslidingSheet{
    .what = "Distance over which friction turns round after a reversal of the motion.",
    .unit = "mm",
    .range =
        "Instrument: at 0.2 um a good frame's position noise hides it. Physics: at 1 mm, a tenth of the rig's travel, "
        "the bristle is a spring.",
    .errors =
        "Noise of the position makes reversals that were not there and shortens it; if all reversals are larger than "
        "it, it "
        "is undetermined. Mistaken for play."};

/// As a number of an effect, searched from `starts`.
[[nodiscard]] inline Parameter presliding(std::vector<double> starts) {
  return {.name = "presliding_mm",
          .symbol = "delta",
          .lower = 2e-4,
          .upper = 1.0,
          .starts = std::move(starts),
          .logarithmic = true,
          .traits = {.lower_limit_law = "ideal dry friction"},
          .sheet = kPreslidingSheet};
}

/// Dahl's bristle z in [-1, 1], dz/dx = (1 - z sign(dx)) / delta: rate-independent, with presliding. Exact on
/// any monotone step, so the size of the step does not matter (Dahl 1968).
class DahlBristle {
 public:
  explicit DahlBristle(double presliding_mm) noexcept : presliding_mm_(presliding_mm) {}
  void reset() noexcept { z_ = 0.0; }
  /// z after sliding on by `slide_mm`.
  double slide(double slide_mm) noexcept {
    const double s = sign_of(slide_mm);
    if (s != 0.0) z_ = s + (z_ - s) * std::exp(-std::fabs(slide_mm) / presliding_mm_);
    return z_;
  }

 private:
  double presliding_mm_;
  double z_ = 0.0;
};

}  // namespace isorig::model::effect
