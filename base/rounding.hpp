#pragma once
#include <cmath>
#include <cstdint>

namespace isorig::base {

/// std::llround without the call: to nearest, halves away from zero, the same integer for every finite |value| < 2^63.
/// What is added is the largest double below a half: 0.5 itself would carry the largest double below 0.5 up to 1.
[[nodiscard]] inline std::int64_t rounded(double value) noexcept {
  return static_cast<std::int64_t>(value + std::copysign(0x1.fffffffffffffp-2, value));
}

}  // namespace isorig::base
