#pragma once
#include <atomic>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "sim/wire/pressure/emulated_teensy.hpp"
#include "sim/wire/pressure/teensy_descriptors.hpp"

namespace isorig::sim {

/// What can go wrong on the bus; set from any thread.
struct TeensyUsbFaults {
  std::atomic<bool> stall_in{false};  ///< the endpoint halts once; the host has to clear it
  std::atomic<bool> stall_out{false};
  std::atomic<std::uint32_t> errors_in{0};  ///< so many transactions fail (EPROTO)
  std::atomic<std::uint32_t> errors_out{0};
  std::atomic<bool> silent_in{false};       ///< the endpoint never completes
  std::atomic<bool> silent_control{false};  ///< nor does any class request
  std::atomic<bool> bootloader{false};      ///< runs HalfKay instead of its program, as after 134 baud
};

/// A Teensy on USB: the bus side of a device for vhci-hcd, the kernel's USB/IP host
/// (Documentation/usb/usbip_protocol.rst), over a socket pair. The kernel enumerates it, binds cdc_acm, and udev names
/// it, as with a real one. Needs root and the module vhci-hcd: a machine for tests, such as the virtual bench.
///
/// Descriptors, endpoints and answers are those of the serial type of Teensy 3.6 (Teensy cores, usb_desc.c,
/// usb_dev.c): 2 interrupt IN, 3 bulk OUT, 4 bulk IN of 64 bytes; a frame is sent as full packets and a short one, and
/// no zero-length packet follows a full one.
class TeensyUsbip final : public EmulatedTeensy {
 public:
  using Port = TeensyPort;

  /// Plugs it in. Throws std::system_error without vhci-hcd, the rights for it, or a free port.
  TeensyUsbip(const Options& options, pressure::Device& backend, std::int64_t now_ns)
      : TeensyUsbip(options, backend, now_ns, Port{}) {}
  TeensyUsbip(const Options& options, pressure::Device& backend, std::int64_t now_ns, Port port);
  ~TeensyUsbip() override { pull_out(); }

  [[nodiscard]] int fd() const noexcept override { return fd_; }
  [[nodiscard]] TeensyUsbFaults& usb_faults() noexcept { return usb_faults_; }

  /// What the host did to the port since it was plugged in.
  struct Seen {
    std::atomic<bool> dtr{false};
    std::atomic<std::uint32_t> baud{0};  ///< of the last line coding; 0: none was set
    std::atomic<std::uint32_t> line_codings{0};
    std::atomic<std::uint32_t> cleared_halts{0};
    std::atomic<std::uint32_t> pending_reads{0};  ///< bulk IN requests that wait for data
  };
  [[nodiscard]] const Seen& seen() const noexcept { return seen_; }

 private:
  struct Request {
    std::uint32_t sequence = 0;
    std::uint32_t endpoint = 0;
    bool is_in = false;
    std::uint32_t length = 0;
    std::vector<std::uint8_t> data;  // to the device, or gathered for the host
  };

  void plug_in() override;
  void pull_out() noexcept override;
  [[nodiscard]] bool is_plugged_in() const noexcept override { return fd_ >= 0; }
  bool service_port() noexcept override;
  std::size_t take(std::span<std::uint8_t> out) noexcept override;
  std::size_t give(std::span<const std::uint8_t> bytes) noexcept override;

  void follow_bootloader();
  void receive() noexcept;
  void handle(const std::uint8_t* header, Request request);
  void unlink(std::uint32_t sequence, std::uint32_t victim);
  void control(const std::uint8_t* setup, Request& request);
  [[nodiscard]] bool class_request(const std::uint8_t* setup, Request& request);
  void strike_endpoints() noexcept;
  void reply(const Request& request, std::int32_t status);
  void flush() noexcept;

  Port port_;
  TeensyUsbFaults usb_faults_;
  Seen seen_;
  int fd_ = -1;
  bool is_bootloader_ = false;
  bool is_in_halted_ = false, is_out_halted_ = false;
  std::int64_t reboot_ns_ = 0;
  std::deque<Request> reads_;   // bulk IN that wait for data
  std::deque<Request> writes_;  // bulk OUT that wait for the firmware
  std::deque<Request> never_;   // interrupt IN, and whatever a fault swallows
  std::vector<std::uint8_t> from_kernel_;
  std::vector<std::uint8_t> to_kernel_;
  std::vector<std::uint8_t> line_coding_{0, 0, 0, 0, 0, 0, 0};
};

}  // namespace isorig::sim
