#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace isorig::sim {

/// Cuts what a client sends into requests, as the specifications say (MODBUS Application Protocol V1.1b3, Messaging on
/// TCP/IP V1.0b, over serial line V1.02). libmodbus 3.1.6 cannot: it guesses a request's length from its function, so a
/// request with a function that it does not know puts the connection out of step.
///
/// Nothing here is shared with drivers/modbus/modbus_adu.hpp, the CRC included, on purpose: the emulator judges the
/// driver, and an error in common code would be right on both sides.
class ModbusRequests {
 public:
  using Clock = std::chrono::steady_clock;
  struct Request {
    std::vector<std::uint8_t> adu;  ///< as it came
    std::size_t pdu_at = 0;
    std::size_t pdu_size = 0;
    std::uint8_t unit = 0;
    [[nodiscard]] std::span<const std::uint8_t> pdu() const { return std::span(adu).subspan(pdu_at, pdu_size); }
  };

  explicit ModbusRequests(bool rtu) : rtu_(rtu) {}

  void add(std::span<const std::uint8_t> bytes, Clock::time_point now);
  /// The next whole request. RTU: with a right CRC, for whatever unit; the rest of what came before a silence is noise.
  std::optional<Request> next(Clock::time_point now);
  /// TCP: the bytes where a header should stand cannot be a header. Nothing can be cut any more: close the connection.
  [[nodiscard]] bool is_lost() const noexcept { return lost_; }
  void clear() noexcept;

 private:
  std::optional<Request> next_tcp();
  std::optional<Request> next_rtu(Clock::time_point now);
  Request take(std::size_t size);

  bool rtu_;
  bool lost_ = false;
  std::vector<std::uint8_t> bytes_;
  Clock::time_point last_byte_;
};

/// CRC-16 of the serial line: polynomial 0x8005 reflected, from 0xFFFF, low byte first on the wire.
[[nodiscard]] std::uint16_t rtu_crc(std::span<const std::uint8_t> bytes) noexcept;

/// What a server of functions 3, 4, 6 and 16 says to a request before it looks at its registers: an exception's code,
/// or 0.
[[nodiscard]] std::uint8_t exception_for(std::span<const std::uint8_t> pdu, std::size_t max_read,
                                         std::size_t max_write);

}  // namespace isorig::sim
