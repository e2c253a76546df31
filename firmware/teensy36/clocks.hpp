#pragma once
#include <stdint.h>

namespace isorig::firmware::teensy36 {

inline constexpr uint32_t kCore_MHz = 180;
inline constexpr uint32_t kBus_MHz = 60;

/// From reset to 180 MHz core, 60 MHz bus, 25.7 MHz flash, and the cycle counter running. Reads the serial
/// number on the way, since the flash takes no commands at this speed.
void start_clocks() noexcept;

/// As on the label that PJRC's tools show: the number that the factory wrote, in decimal, times ten if that
/// is below ten million.
[[nodiscard]] const char* serial_number() noexcept;

}  // namespace isorig::firmware::teensy36
