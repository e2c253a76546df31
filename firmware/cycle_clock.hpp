#pragma once
#include <stdint.h>

namespace isorig::firmware {

/// A 32-bit cycle counter extended to 64 bit: never wraps, never steps, and keeps every cycle, so that
/// microseconds do not drift against the crystal. The DWT counter of a Cortex-M4 at 180 MHz wraps each 23.86
/// s (ARM DDI 0403, "CYCCNT"); advance() has to see it more often than that. The main loop calls it in every
/// pass.
class CycleClock {
 public:
  explicit constexpr CycleClock(uint32_t cycles_per_us) noexcept : cycles_per_us_(cycles_per_us) {}

  /// Takes a reading of the counter; returns the extended count. Modulo 2^32, so a wrap needs no care.
  constexpr uint64_t advance(uint32_t counter) noexcept {
    cycles_ += static_cast<uint32_t>(counter - last_);
    last_ = counter;
    return cycles_;
  }

  /// Whole microseconds, rounded down.
  [[nodiscard]] constexpr uint64_t us(uint64_t cycles) const noexcept { return cycles / cycles_per_us_; }
  [[nodiscard]] constexpr uint64_t cycles(uint64_t us) const noexcept { return us * cycles_per_us_; }
  [[nodiscard]] constexpr uint32_t cycles_per_us() const noexcept { return cycles_per_us_; }

 private:
  uint32_t cycles_per_us_;
  uint32_t last_ = 0;
  uint64_t cycles_ = 0;
};

}  // namespace isorig::firmware
