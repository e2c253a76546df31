#include "sim/wire/modbus_requests.hpp"

#include <algorithm>

namespace isorig::sim {
namespace {

constexpr std::size_t kHeader = 6;  // up to and with the length
constexpr std::size_t kLongestPdu = 253;
constexpr std::size_t kLongestLength = 1024;  // more than a Modbus length can be, and still skipped
constexpr std::size_t kLongestRtu = 256;
// 3.5 characters on a line; a pseudo-terminal has none, and its writer may be interrupted.
constexpr auto kSilence = std::chrono::milliseconds(20);
constexpr std::uint8_t kIllegalFunction = 1, kIllegalAddress = 2, kIllegalValue = 3;

std::size_t word_at(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::size_t>((bytes[at] << 8U) | bytes[at + 1]);
}

/// Of a frame with its own CRC it is 0.
bool crc_is_right(std::span<const std::uint8_t> bytes) {
  return rtu_crc(bytes) == 0;
}

/// Of a request that the serial line's specification names, by its function; 0: its end shows in the silence alone.
std::size_t rtu_size(std::span<const std::uint8_t> bytes) {
  const auto function = bytes[1];
  if (function >= 1 && function <= 6) return 8;
  if ((function == 15 || function == 16) && bytes.size() > 6) return 9U + bytes[6];
  return 0;
}

}  // namespace

std::uint16_t rtu_crc(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t crc = 0xFFFF;
  for (const auto byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
  }
  return static_cast<std::uint16_t>(crc);
}

void ModbusRequests::add(std::span<const std::uint8_t> bytes, Clock::time_point now) {
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  last_byte_ = now;
}

void ModbusRequests::clear() noexcept {
  bytes_.clear();
  lost_ = false;
}

ModbusRequests::Request ModbusRequests::take(std::size_t size) {
  Request request;
  const auto end = bytes_.begin() + static_cast<std::ptrdiff_t>(size);
  request.adu.assign(bytes_.begin(), end);
  bytes_.erase(bytes_.begin(), end);
  return request;
}

std::optional<ModbusRequests::Request> ModbusRequests::next(Clock::time_point now) {
  return rtu_ ? next_rtu(now) : next_tcp();
}

std::optional<ModbusRequests::Request> ModbusRequests::next_tcp() {
  while (!lost_ && bytes_.size() >= kHeader) {
    const auto length = word_at(bytes_, 4);
    lost_ = length < 2 || length > kLongestLength;
    if (lost_ || bytes_.size() < kHeader + length) return std::nullopt;
    const bool modbus = word_at(bytes_, 2) == 0;
    auto request = take(kHeader + length);
    if (!modbus) continue;  // another protocol's: not ours to answer
    request.unit = request.adu[kHeader];
    request.pdu_at = kHeader + 1;
    request.pdu_size = length - 1;
    return request;
  }
  return std::nullopt;
}

std::optional<ModbusRequests::Request> ModbusRequests::next_rtu(Clock::time_point now) {
  const bool silent = now - last_byte_ > kSilence;
  while (bytes_.size() >= 4) {
    std::size_t size = rtu_size(bytes_);
    if (size == 0 || bytes_.size() < size || !crc_is_right(std::span(bytes_).first(size)))
      size = silent ? bytes_.size() : 0;
    if (size == 0) return std::nullopt;
    if (size > kLongestRtu || !crc_is_right(std::span(bytes_).first(size))) {
      bytes_.clear();
      return std::nullopt;
    }
    auto request = take(size);
    request.unit = request.adu[0];
    request.pdu_at = 1;
    request.pdu_size = size - 3;
    return request;
  }
  if (silent) bytes_.clear();
  return std::nullopt;
}

std::uint8_t exception_for(std::span<const std::uint8_t> pdu, std::size_t max_read, std::size_t max_write) {
  const auto function = pdu[0];
  if (function != 3 && function != 4 && function != 6 && function != 16) return kIllegalFunction;
  if (pdu.size() > kLongestPdu || pdu.size() < 5) return kIllegalValue;
  if (function == 6) return pdu.size() == 5 ? 0 : kIllegalValue;
  const auto count = word_at(pdu, 3);
  const bool write = function == 16;
  if (count < 1 || count > (write ? max_write : max_read)) return kIllegalValue;
  if (!write && pdu.size() != 5) return kIllegalValue;
  if (write && (pdu.size() < 6 || pdu[5] != 2 * count || pdu.size() != 6 + 2 * count)) return kIllegalValue;
  return word_at(pdu, 1) + count > 0x10000 ? kIllegalAddress : 0;
}

}  // namespace isorig::sim
