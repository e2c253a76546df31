#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <string>

#include "drivers/clock/real_clock.hpp"
#include "drivers/config/modbus_config.hpp"
#include "drivers/modbus/modbus_adu.hpp"

namespace isorig::modbus {

/// One Modbus connection on which an answer is never taken for that of another request.
///
/// Every answer is compared with its request: transaction, protocol, length and unit (TCP), unit and CRC (RTU),
/// function, byte count, echoed address. The trap left is time: after a time-out the old answer may still arrive.
///  - TCP: it carries its own transaction's number, and is thrown away when it comes. A header that cannot be one means
///    that the stream is out of step: the socket is closed, and the next call opens another.
///  - RTU, where nothing numbers the requests: the next call waits out the response time-out, flushes, and reads a
///  block
///    whose length differs from that of any request that went unanswered. A unit answers in order, so when that answer
///    comes, no older one can follow.
///
/// Every call is bounded: connect (TCP, out of step) or response and probe's response (RTU, in doubt), and a response
/// time-out; write_at_once() by one response time-out. Not thread-safe.
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
  /// For what may be written twice and must not wait: goes out first, whatever is in doubt; over TCP again after half a
  /// response time-out without an answer.
  void write_at_once(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words);

  /// No request after this waits beyond `until_ns` for its answer; 0: each for its own time-out.
  void limit(std::int64_t until_ns) noexcept { limit_ns_ = until_ns; }

  /// How often the line was in doubt and brought back in step, or an answer came after its time and was thrown away.
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return resyncs_; }

 private:
  struct Frame {
    std::uint16_t transaction = 0;
    std::uint8_t unit = 0;
    Message pdu;
  };
  /// What a request is for. Made into words when it fails: each poll has several, in a thread that allocates nothing.
  struct Purpose {
    const char* doing = "";
    std::uint16_t address = 0;
    std::size_t registers = 0;  ///< 0: `doing` says all
    [[nodiscard]] std::string words() const;
  };

  void open_line();
  void get_in_step();
  void probe();
  void wait_for_gap();
  Message ask(const Message& request, const Purpose& what, std::size_t read_length);
  Message await(const Message& request, std::int64_t until_ns, const Purpose& what, std::size_t read_length);
  void check(const Message& request, const Frame& frame, const Purpose& what, std::size_t read_length);
  void send(const Message& request, const Purpose& what);
  bool fill(std::int64_t until_ns, const Purpose& what);
  bool take_tcp(Frame& frame, const Purpose& what);
  bool take_rtu(Frame& frame, const Purpose& what, std::size_t read_length);
  void doubt(std::size_t read_length) noexcept;
  void flush() noexcept;
  [[noreturn]] void fail_no_answer(const Purpose& what, std::int64_t since_ns, std::size_t read_length);
  [[noreturn]] void fail_protocol(const Purpose& what, const std::string& why, std::size_t read_length);
  [[noreturn]] void fail_exception(const Purpose& what, std::uint8_t code) const;
  [[noreturn]] void fail_disconnected(const Purpose& what, const std::string& why);
  [[nodiscard]] std::int64_t timeout_ns() const noexcept {
    return std::int64_t{config_.response_timeout_ms} * 1'000'000;
  }
  [[nodiscard]] bool rtu() const noexcept { return config_.transport == ModbusTransport::kRtu; }
  [[nodiscard]] std::string at() const;

  ModbusConfig config_;
  std::string device_;
  ReadBlock probe_block_;
  clock::RealClock clock_;  // the line lives in real time, whatever clock stamps the samples
  int fd_ = -1;
  bool open_ = false;
  bool in_doubt_ = false;  // TCP: the socket is closed
  std::int64_t doubt_until_ns_ = 0;
  std::int64_t last_byte_ns_ = 0;
  std::int64_t gap_ns_ = 0;
  std::int64_t limit_ns_ = 0;
  FixedBytes<1024> received_;  // at most one answer that is not whole, and what one read brings
  std::uint16_t transaction_ = 0;
  std::deque<std::uint16_t> late_;      // TCP: transactions that may still be answered
  std::array<bool, 126> unanswered_{};  // RTU: lengths of reads that may still be answered
  std::uint64_t resyncs_ = 0;
};

}  // namespace isorig::modbus
