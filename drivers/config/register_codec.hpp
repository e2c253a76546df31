#pragma once
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

/// Numbers in 16-bit registers. Modbus fixes only the byte order inside one register (big endian, undone by
/// libmodbus); how a 32-bit number lies in two registers is the gateway maker's choice. libmodbus' own float
/// helpers give different answers in 3.1.6, 3.1.8-3.1.10 and 3.1.11 (its issues 665, 694, 757), so none is
/// used.
namespace isorig::modbus {

enum class RegisterType : std::uint8_t { kInt16, kUint16, kInt32, kUint32, kFloat32 };

/// Where the bytes A (most significant) to D of a 32-bit number stand on the wire. A 16-bit number is AB in
/// the first two orders and BA in the last two.
enum class WordOrder : std::uint8_t {
  kABCD,  ///< big endian throughout: the Modbus habit
  kCDAB,  ///< low word first
  kBADC,  ///< high word first, bytes swapped in each register
  kDCBA,  ///< little endian throughout
};

[[nodiscard]] constexpr std::size_t registers_of(RegisterType type) noexcept {
  return type == RegisterType::kInt16 || type == RegisterType::kUint16 ? 1 : 2;
}

[[nodiscard]] constexpr std::uint16_t swap_bytes(std::uint16_t word) noexcept {
  return static_cast<std::uint16_t>((word << 8) | (word >> 8));
}

[[nodiscard]] constexpr bool swaps_bytes(WordOrder order) noexcept {
  return order == WordOrder::kBADC || order == WordOrder::kDCBA;
}

[[nodiscard]] constexpr bool low_word_first(WordOrder order) noexcept {
  return order == WordOrder::kCDAB || order == WordOrder::kDCBA;
}

/// The bits of a number of `type` from its registers. `words` holds at least registers_of(type).
[[nodiscard]] constexpr std::uint32_t join_words(std::span<const std::uint16_t> words, RegisterType type,
                                                 WordOrder order) noexcept {
  const auto word = [&](std::size_t i) { return swaps_bytes(order) ? swap_bytes(words[i]) : words[i]; };
  if (registers_of(type) == 1) return word(0);
  const std::uint32_t first = word(0), second = word(1);
  return low_word_first(order) ? (second << 16) | first : (first << 16) | second;
}

/// The reverse; the second word is meaningless for a 16-bit type.
[[nodiscard]] constexpr std::array<std::uint16_t, 2> split_words(std::uint32_t bits, RegisterType type,
                                                                 WordOrder order) noexcept {
  const auto word = [&](std::uint32_t value) {
    const auto low = static_cast<std::uint16_t>(value & 0xFFFFU);
    return swaps_bytes(order) ? swap_bytes(low) : low;
  };
  if (registers_of(type) == 1) return {word(bits), 0};
  if (low_word_first(order)) return {word(bits), word(bits >> 16)};
  return {word(bits >> 16), word(bits)};
}

/// The number the bits stand for, before scale and offset. Exact: a double holds every 32-bit integer.
[[nodiscard]] constexpr double number_of(std::uint32_t bits, RegisterType type) noexcept {
  switch (type) {
    case RegisterType::kInt16:
      return static_cast<std::int16_t>(bits);
    case RegisterType::kUint16:
      return static_cast<std::uint16_t>(bits);
    case RegisterType::kInt32:
      return static_cast<std::int32_t>(bits);
    case RegisterType::kUint32:
      return bits;
    case RegisterType::kFloat32:
      return static_cast<double>(std::bit_cast<float>(bits));
  }
  return 0.0;
}

struct RegisterRange {
  double min = 0.0;
  double max = 0.0;
};

[[nodiscard]] constexpr RegisterRange range_of(RegisterType type) noexcept {
  switch (type) {
    case RegisterType::kInt16:
      return {-32768.0, 32767.0};
    case RegisterType::kUint16:
      return {0.0, 65535.0};
    case RegisterType::kInt32:
      return {-2147483648.0, 2147483647.0};
    case RegisterType::kUint32:
      return {0.0, 4294967295.0};
    case RegisterType::kFloat32:
      break;
  }
  constexpr auto largest = static_cast<double>(std::numeric_limits<float>::max());
  return {-largest, largest};
}

/// The bits nearest to `number`; nothing when it is not finite or does not fit: a set-point is refused, never
/// clamped or wrapped.
[[nodiscard]] inline std::optional<std::uint32_t> bits_of(double number, RegisterType type) noexcept {
  const double value = type == RegisterType::kFloat32 ? number : std::nearbyint(number);
  const auto range = range_of(type);
  if (!(value >= range.min && value <= range.max)) return std::nullopt;
  if (type == RegisterType::kFloat32) return std::bit_cast<std::uint32_t>(static_cast<float>(value));
  return static_cast<std::uint32_t>(static_cast<std::int64_t>(value));
}

}  // namespace isorig::modbus
