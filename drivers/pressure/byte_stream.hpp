#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace isorig::pressure {

/// What carries the Teensy's bytes: a tty now, USB bulk transfers as an alternative. Frames, identity and
/// time are the business of the caller. Owned by one I/O thread. All but close() throw drivers::DeviceError.
class ByteStream {
 public:
  virtual ~ByteStream() = default;
  /// Opens the device, alone and with nothing left over from before. Throws kDisconnected when it is not
  /// there or held by another program, kRefused without the rights, kIdentity when it is no such device at
  /// all.
  virtual void open() = 0;
  /// Never blocks, whatever the device does.
  virtual void close() noexcept = 0;
  [[nodiscard]] virtual bool is_open() const noexcept = 0;
  /// Waits up to `timeout_ns` for the first byte and returns what there is; 0 when nothing came. Throws
  /// kDisconnected when the device is gone.
  virtual std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) = 0;
  /// CLOCK_MONOTONIC of the moment when what read_some() last returned had arrived; nothing when the stream cannot
  /// tell any better than its caller.
  [[nodiscard]] virtual std::optional<std::int64_t> arrived_ns() const noexcept { return std::nullopt; }
  /// True once after a device that was away has come back: open() now, not at the end of a back-off.
  [[nodiscard]] virtual bool has_reappeared() noexcept { return false; }
  /// All of `bytes`, or an error: kTimeout when the device takes no more for too long (part of `bytes` may
  /// have gone), kDisconnected when it is gone.
  virtual void write_all(std::span<const std::uint8_t> bytes) = 0;
  /// How messages to the operator name it.
  [[nodiscard]] virtual std::string name() const = 0;
};

}  // namespace isorig::pressure
