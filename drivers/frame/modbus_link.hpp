#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "drivers/clock/clock.hpp"
#include "drivers/frame/modbus_config.hpp"

// libmodbus' own handle, kept out of this header.
struct _modbus;

namespace isorig::frame {

/// One Modbus connection on which an answer is never taken for that of another request.
///
/// The trap: after a time-out the old answer may still arrive. libmodbus gives it to the next request; on
/// RTU, where nothing numbers the requests, it is accepted when unit, function and length agree. And its own
/// cure, MODBUS_ERROR_RECOVERY_LINK, retries for ever inside one call. So recovery stays NONE, and after any
/// failure that leaves the line in doubt the next call first gets back in step:
///  - TCP: the socket is closed and a new one opened; an old answer has nowhere to arrive. (Transaction
///  numbers,
///    which libmodbus checks, guard the rest.)
///  - RTU: wait out the response time-out, flush, and read a block whose length differs from that of any
///  request
///    that went unanswered. A unit answers in order, so when that answer comes, no older one can follow.
///
/// Every call is bounded: connect + (RTU: response + probe's response) + response time-out. Not thread-safe.
class ModbusLink {
 public:
  explicit ModbusLink(const ModbusConfig& config) : ModbusLink(config, config.map.header_block(), "frame") {}
  /// For a device that is no frame: of `config` the line and the unit count. `probe` is a block that can be read in any
  /// length up to its own.
  ModbusLink(const ModbusConfig& config, ReadBlock probe, std::string device);
  ~ModbusLink();
  ModbusLink(const ModbusLink&) = delete;
  ModbusLink& operator=(const ModbusLink&) = delete;

  /// Throws DeviceError kDisconnected.
  void open();
  void close() noexcept;
  [[nodiscard]] bool is_open() const noexcept { return open_; }

  /// `function` 3 or 4; at most 125 registers. Throws DeviceError; closes the link on kDisconnected.
  void read(std::uint8_t function, std::uint16_t address, std::span<std::uint16_t> words);
  /// `function` 6 (one register) or 16.
  void write(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words);

  /// How often the line was in doubt and brought back in step.
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return resyncs_; }

 private:
  struct Free {
    void operator()(_modbus* context) const noexcept;
  };

  void connect_tcp();
  [[noreturn]] void fail_too_high() const;
  void connect_rtu();
  void get_in_step();
  void probe();
  void wait_for_gap();
  void done() noexcept;
  [[noreturn]] void fail(int error, const std::string& what, std::size_t read_length);
  [[nodiscard]] std::string at() const;

  ModbusConfig config_;
  std::string device_;
  ReadBlock probe_block_;
  std::unique_ptr<_modbus, Free> context_;
  clock::RealClock clock_;  // the line lives in real time, whatever clock stamps the samples
  bool open_ = false;
  bool in_doubt_ = false;
  std::int64_t doubt_until_ns_ = 0;
  std::int64_t last_byte_ns_ = 0;
  std::int64_t gap_ns_ = 0;
  std::array<bool, 126> unanswered_{};  // lengths of reads that may still be answered
  std::uint64_t resyncs_ = 0;
};

}  // namespace isorig::frame
