#pragma once
#include <cstdint>

#include "drivers/api/clock.hpp"

namespace isorig::clock {

/// CLOCK_MONOTONIC and clock_nanosleep(TIMER_ABSTIME).
class RealClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override;
  void sleep_until_ns(std::int64_t deadline_ns) noexcept override;
};

}  // namespace isorig::clock
