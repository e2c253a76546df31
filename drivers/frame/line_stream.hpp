#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "drivers/api/clock.hpp"

namespace isorig::frame {

/// Lines that end in CR LF, over TCP or a serial line. Bounded: nothing here waits longer than it is told. One thread.
class LineStream {
 public:
  struct Options {
    bool tcp = true;
    std::string host;
    std::uint16_t port = 0;
    int connect_timeout_ms = 1000;
    std::string tty;
    int baud = 9600;
    char parity = 'N';
    int stop_bits = 1;
    std::string name;  ///< for messages
  };
  struct Line {
    std::string text;              ///< without its end
    std::int64_t received_ns = 0;  ///< when its last byte was read
  };

  LineStream(Options options, clock::Clock& clock) : options_(std::move(options)), clock_(clock) {}
  ~LineStream() { close(); }
  LineStream(const LineStream&) = delete;
  LineStream& operator=(const LineStream&) = delete;

  /// Throws DeviceError: kDisconnected when it is not there or held by another program, kRefused without the rights.
  void open();
  /// At most 0.1 s, for a tty that still has to send what was written.
  void close() noexcept;
  [[nodiscard]] bool is_open() const noexcept { return fd_ >= 0; }

  /// Sends the line and CR LF. Throws kTimeout when the other side takes nothing any more, kDisconnected when it is
  /// gone.
  void write_line(std::string_view line);
  /// The next line, if it is whole by `until_ns`; looks at least once. Throws kDisconnected when the other side is
  /// gone, kProtocol for what can be no line.
  std::optional<Line> read_line(std::int64_t until_ns);
  /// Throws away what has come in so far; true when there was something.
  bool discard_input();

 private:
  void fill(std::int64_t until_ns);
  [[noreturn]] void fail_disconnected(const std::string& what);

  Options options_;
  clock::Clock& clock_;
  int fd_ = -1;
  std::string received_;
  std::int64_t received_ns_ = 0;
};

}  // namespace isorig::frame
