#pragma once
#include <stddef.h>
#include <stdint.h>

namespace isorig::firmware {

inline constexpr size_t kSerialTextSize = 11;

/// The serial number as text, as PJRC's tools show it: in decimal, times ten if below ten million (their way
/// round a defect of an old driver, kept so that the same board has the same name under any firmware).
constexpr void write_serial(uint32_t number, char (&out)[kSerialTextSize]) noexcept {
  if (number < 10'000'000) number *= 10;
  char digits[kSerialTextSize] = {};
  size_t count = 0;
  do {
    digits[count++] = static_cast<char>('0' + number % 10);
    number /= 10;
  } while (number != 0);
  for (size_t i = 0; i < count; ++i) out[i] = digits[count - 1 - i];
  out[count] = '\0';
}

}  // namespace isorig::firmware
