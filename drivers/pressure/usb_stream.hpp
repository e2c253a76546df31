#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "drivers/pressure/byte_stream.hpp"
#include "drivers/pressure/usb_session.hpp"

namespace isorig::pressure {

/// A Teensy on USB without the tty layer: asynchronous bulk transfers through libusb, stamped when they complete
/// (docs/usb.md). Found by VID:PID and serial number, wherever it is plugged in.
///
/// One event thread per stream, from the first open() to the destructor. Where udev runs, libusb's hot-plug callback
/// tells of a device that came; without udev (libusb then promises callbacks that never come) sysfs is looked at.
class UsbStream final : public ByteStream {
 public:
  struct Options {
    /// As USB shows it (`isorig devices`); empty takes the only Teensy there is.
    std::string serial;
    /// SCHED_FIFO of the event thread, so that a packet is stamped when it comes; 0 leaves it ordinary.
    int event_priority = 0;
    UsbSession::Options session{};
  };

  explicit UsbStream(Options options);
  ~UsbStream() override;
  UsbStream(const UsbStream&) = delete;
  UsbStream& operator=(const UsbStream&) = delete;

  void open() override;
  /// The event thread gives the device back; waited for at most half a second.
  void close() noexcept override;
  [[nodiscard]] bool is_open() const noexcept override { return session_ != nullptr; }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override;
  void write_all(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::optional<std::int64_t> arrived_ns() const noexcept override { return arrived_ns_; }
  [[nodiscard]] bool has_reappeared() noexcept override;
  [[nodiscard]] std::string name() const override;

  [[nodiscard]] const UsbCounters& counters() const noexcept;
  /// Whether hot-plug callbacks are in use.
  [[nodiscard]] bool has_hotplug() const noexcept;

 private:
  class Events;

  Options options_;
  std::shared_ptr<Events> events_;
  std::shared_ptr<UsbSession> session_;
  std::int64_t arrived_ns_ = 0;
  std::string last_node_;  // of the device that was open or looked at last
  std::int64_t next_look_ns_ = 0;
};

}  // namespace isorig::pressure
