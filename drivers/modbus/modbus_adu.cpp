#include "drivers/modbus/modbus_adu.hpp"

#include <algorithm>

namespace isorig::modbus {
namespace {

void append(Message& bytes, std::uint16_t word) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8U));
  bytes.push_back(static_cast<std::uint8_t>(word & 0xFFU));
}

}  // namespace

std::uint16_t crc16(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t crc = 0xFFFF;
  for (const auto byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
  }
  return static_cast<std::uint16_t>(crc);
}

Message read_request(std::uint8_t function, std::uint16_t address, std::uint16_t count) {
  Message pdu;
  pdu.push_back(function);
  append(pdu, address);
  append(pdu, count);
  return pdu;
}

Message write_request(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words) {
  Message pdu;
  pdu.push_back(function);
  append(pdu, address);
  if (function == 16) {
    append(pdu, static_cast<std::uint16_t>(words.size()));
    pdu.push_back(static_cast<std::uint8_t>(2 * words.size()));
  }
  for (const auto word : words) append(pdu, word);
  return pdu;
}

Message tcp_frame(std::uint16_t transaction, std::uint8_t unit, std::span<const std::uint8_t> pdu) {
  Message frame;
  append(frame, transaction);
  append(frame, 0);
  append(frame, static_cast<std::uint16_t>(pdu.size() + 1));
  frame.push_back(unit);
  frame.append(pdu);
  return frame;
}

Message rtu_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu) {
  Message frame;
  frame.push_back(unit);
  frame.append(pdu);
  const auto crc = crc16(frame);
  frame.push_back(static_cast<std::uint8_t>(crc & 0xFFU));
  frame.push_back(static_cast<std::uint8_t>(crc >> 8U));
  return frame;
}

std::string fault_in_answer(std::span<const std::uint8_t> request, std::span<const std::uint8_t> answer) {
  const auto number = [](std::size_t n) { return std::to_string(n); };
  if (answer.empty()) return "no function";
  const auto function = request[0];
  if (answer[0] == (function | kExceptionBit)) {
    return answer.size() == 2 ? "" : "an exception of " + number(answer.size()) + " bytes instead of 2";
  }
  if (answer[0] != function) return "function " + number(answer[0]) + " instead of " + number(function);
  if (function == 3 || function == 4) {
    const std::size_t wanted = 2U * word_at(request, 3);
    if (answer.size() < 2 || answer[1] != wanted) {
      return (answer.size() < 2 ? std::string("no") : number(answer[1])) + " bytes of registers instead of " +
             number(wanted);
    }
    if (answer.size() != 2 + wanted) {
      return "a length of " + number(answer.size()) + " bytes instead of " + number(2 + wanted);
    }
    return {};
  }
  if (answer.size() != 5) return "a length of " + number(answer.size()) + " bytes instead of 5";
  // Both writes echo the address; 6 the value, 16 the count: where the request has them too.
  if (!std::equal(answer.begin(), answer.end(), request.begin())) return "the echo of another write";
  return {};
}

std::optional<std::uint8_t> exception_in(std::span<const std::uint8_t> answer) noexcept {
  if (answer.size() != 2 || (answer[0] & kExceptionBit) == 0) return std::nullopt;
  return answer[1];
}

std::string exception_text(std::uint8_t code) {
  switch (code) {
    case 1:
      return "illegal function";
    case 2:
      return "illegal data address";
    case 3:
      return "illegal data value";
    case 4:
      return "server device failure";
    case 5:
      return "acknowledge: it takes longer";
    case 6:
      return "server device busy";
    case 7:
      return "negative acknowledge";
    case 8:
      return "memory parity error";
    case 10:
      return "gateway path unavailable";
    case 11:
      return "gateway target device failed to respond";
    default:
      return "exception " + std::to_string(code);
  }
}

std::optional<std::size_t> rtu_answer_size(std::span<const std::uint8_t> begin) noexcept {
  if (begin.size() < 2) return std::nullopt;
  const auto function = begin[1];
  if ((function & kExceptionBit) != 0) return 5;
  if (function == 6 || function == 16) return 8;
  if (function != 3 && function != 4) return 0;
  if (begin.size() < 3) return std::nullopt;
  return 5U + begin[2];
}

}  // namespace isorig::modbus
