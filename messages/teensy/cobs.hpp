#pragma once
#include <stddef.h>
#include <stdint.h>

/// Consistent Overhead Byte Stuffing: S. Cheshire, M. Baker, IEEE/ACM Trans. Networking 7(2), 1999. Removes
/// the zeros from a packet, so that a zero ends every frame and a receiver finds the next one after any
/// damage.
namespace isorig::messages::teensy {

/// Longest encoding of `size` bytes, without the zero that ends the frame: a byte per started block of 254.
[[nodiscard]] constexpr size_t cobs_max_encoded(size_t size) noexcept {
  return size + size / 254 + 1;
}

/// Encodes into `out`, which holds at least cobs_max_encoded(size) bytes and does not overlap. Returns the
/// length, without the ending zero. A final block of exactly 254 bytes needs no further code byte (the form
/// of the paper's listing would add one; both decode alike).
constexpr size_t cobs_encode(const uint8_t* data, size_t size, uint8_t* out) noexcept {
  size_t code_at = 0;
  size_t length = 1;
  uint8_t code = 1;
  for (size_t i = 0; i < size; ++i) {
    if (code == 0xFF) {
      out[code_at] = code;
      code_at = length++;
      code = 1;
    }
    if (data[i] != 0) {
      out[length++] = data[i];
      ++code;
    } else {
      out[code_at] = code;
      code_at = length++;
      code = 1;
    }
  }
  out[code_at] = code;
  return length;
}

inline constexpr size_t kCobsInvalid = static_cast<size_t>(-1);

/// Decodes a frame without its ending zero; `out` may be `data` itself. Returns the length, or kCobsInvalid
/// for a zero inside or a block that runs past the end (a truncated frame).
constexpr size_t cobs_decode(const uint8_t* data, size_t size, uint8_t* out) noexcept {
  size_t read = 0;
  size_t written = 0;
  while (read < size) {
    const uint8_t code = data[read++];
    if (code == 0 || static_cast<size_t>(code - 1) > size - read) return kCobsInvalid;
    for (uint8_t i = 1; i < code; ++i) {
      if (data[read] == 0) return kCobsInvalid;
      out[written++] = data[read++];
    }
    if (code != 0xFF && read < size) out[written++] = 0;
  }
  return written;
}

}  // namespace isorig::messages::teensy
