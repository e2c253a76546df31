#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "drivers/modbus/fixed_bytes.hpp"

/// Modbus requests and what may answer them (MODBUS Application Protocol V1.1b3; Messaging on TCP/IP V1.0b; over serial
/// line V1.02). No I/O.
///
/// Written here because libmodbus 3.1.6 accepts as an answer what is none: over TCP it ignores the MBAP header's
/// protocol and length, and the unit; what follows is then out of step. The emulators do not use this file: libmodbus
/// answers there, and sim/wire/modbus_requests.hpp cuts the requests, so that no error here is repeated where it is
/// judged.
namespace isorig::modbus {

inline constexpr std::size_t kHeader = 7;  ///< MBAP: transaction, protocol, length, unit
inline constexpr std::size_t kLongestPdu = 253;
/// A request or an answer, with what a line puts round it: what counts the bytes in one is a byte itself.
using Message = FixedBytes<kHeader + 6 + 255>;
inline constexpr std::uint8_t kExceptionBit = 0x80;

[[nodiscard]] std::uint16_t crc16(std::span<const std::uint8_t> bytes) noexcept;
[[nodiscard]] inline std::uint16_t word_at(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  return static_cast<std::uint16_t>((bytes[at] << 8U) | bytes[at + 1]);
}

/// Functions 3 and 4; 6 (one word) and 16.
[[nodiscard]] Message read_request(std::uint8_t function, std::uint16_t address, std::uint16_t count);
[[nodiscard]] Message write_request(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words);

[[nodiscard]] Message tcp_frame(std::uint16_t transaction, std::uint8_t unit, std::span<const std::uint8_t> pdu);
[[nodiscard]] Message rtu_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu);

/// What is wrong with an answer; empty when nothing is, or when it is an exception.
[[nodiscard]] std::string fault_in_answer(std::span<const std::uint8_t> request, std::span<const std::uint8_t> answer);
/// The code of an exception, of an answer without fault.
[[nodiscard]] std::optional<std::uint8_t> exception_in(std::span<const std::uint8_t> answer) noexcept;
/// "illegal data address", or "exception 77".
[[nodiscard]] std::string exception_text(std::uint8_t code);

/// How long an RTU answer is, unit and CRC included, by its first bytes; nothing while they do not say, 0 for what no
/// answer of the functions above begins with.
[[nodiscard]] std::optional<std::size_t> rtu_answer_size(std::span<const std::uint8_t> begin) noexcept;

}  // namespace isorig::modbus
