#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "drivers/pressure/byte_stream.hpp"

namespace isorig::pressure {

/// A tty by path: /dev/serial/by-id/..., /dev/ttyACM0, or a pseudo-terminal of an emulator.
///
/// Raw mode is set before anything else, since a tty echoes what arrives until then; the same call sets
/// 115200 baud (134 would reboot a Teensy into its boot loader; any other rate means nothing to it).
/// Exclusive twice: TIOCEXCL keeps out other programs, except those of root, which the file lock keeps out if
/// they ask for it.
class TtyStream final : public ByteStream {
 public:
  struct Options {
    std::string path;
    /// How long a write waits for room. A Teensy that takes nothing for this long hangs: at 1 kHz it empties
    /// its buffers every millisecond.
    std::int64_t write_timeout_ns = 50'000'000;
  };

  explicit TtyStream(Options options) : options_(std::move(options)) {}
  ~TtyStream() override { close(); }
  TtyStream(const TtyStream&) = delete;
  TtyStream& operator=(const TtyStream&) = delete;

  void open() override;
  void close() noexcept override;
  [[nodiscard]] bool is_open() const noexcept override { return fd_ >= 0; }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override;
  void write_all(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::string name() const override { return options_.path; }

 private:
  [[noreturn]] void fail_disconnected(const std::string& what);
  /// Waits for `events`; false after the time-out.
  bool wait_for(short events, std::int64_t timeout_ns);

  Options options_;
  int fd_ = -1;
};

}  // namespace isorig::pressure
