#pragma once
#include <stddef.h>
#include <stdint.h>

#include "firmware/packet_queue.hpp"
#include "firmware/usb_descriptors.hpp"
#include "firmware/usb_sie.hpp"

namespace isorig::firmware {

/// A USB serial port (CDC-ACM) on a UsbSie. Polled from the main loop, no interrupts: until poll() comes
/// round the engine answers NAK and the host asks again.
///
/// Banks and data toggles are kept apart: the engine changes bank with each transaction it completes,
/// whatever happens, while the toggles start anew with each configuration and each cleared halt. One that is
/// derived from the other goes wrong at the second configuration.
class UsbDevice {
 public:
  /// `serial` is shown as the serial number and outlives the device.
  UsbDevice(UsbSie& sie, const char* serial) noexcept : sie_(sie), serial_(serial) {}

  void poll() noexcept;

  /// Configured, DTR set, bus alive.
  [[nodiscard]] bool is_open() const noexcept { return is_configured_ && (line_state_ & kDtr) != 0 && !is_asleep_; }
  /// Takes at most one packet of the host: `size` is to be at least 64.
  [[nodiscard]] size_t receive(uint8_t* out, size_t size) noexcept;
  [[nodiscard]] bool send(const uint8_t* bytes, size_t size) noexcept;
  void discard_output() noexcept;

  /// Somebody set 134 baud: 15 ms later, as long as PJRC's own core leaves the host to get its answer, this
  /// is true and the machine is to enter its boot loader.
  [[nodiscard]] bool wants_bootloader() const noexcept { return is_bootloader_due_; }
  [[nodiscard]] uint32_t baud() const noexcept { return get_u32(line_coding_); }

 private:
  static constexpr uint16_t kDtr = 1;
  static constexpr size_t kLineCodingSize = 7;
  static constexpr uint32_t kBootloaderBaud = 134;
  static constexpr uint8_t kBootloaderFrames = 15;

  struct Setup {
    uint8_t type = 0;
    uint8_t request = 0;
    uint16_t value = 0;
    uint16_t index = 0;
    uint16_t length = 0;
  };

  /// Received packets wait in the very buffers the engine filled; the engine answers NAK meanwhile.
  struct OutBank {
    alignas(4) uint8_t bytes[usb::kBulkSize];
    uint16_t size;
    bool is_full;
  };

  void reset() noexcept;
  void control(const UsbSie::Token& token) noexcept;
  void handle_setup() noexcept;
  [[nodiscard]] bool answer(const Setup& setup) noexcept;
  [[nodiscard]] bool answer_descriptor(const Setup& setup) noexcept;
  [[nodiscard]] bool answer_endpoint(const Setup& setup) noexcept;
  void configure(bool is_configured) noexcept;
  void restart_out() noexcept;
  void restart_in() noexcept;
  void arm_out(uint8_t bank) noexcept;
  void fill_in_banks() noexcept;
  void put(const uint8_t* bytes, size_t size) noexcept;
  void put_text(const char* text) noexcept;
  void send_control_part() noexcept;
  static uint32_t get_u32(const uint8_t* bytes) noexcept;

  UsbSie& sie_;
  const char* serial_;

  // Endpoint 0. One IN buffer at a time: a transfer the host breaks off then leaves nothing to account for.
  alignas(4) uint8_t control_out_[2][usb::kControlSize] = {};
  alignas(4) uint8_t control_in_[128] = {};
  Setup setup_;
  size_t control_size_ = 0;
  size_t control_sent_ = 0;
  bool is_sending_ = false;
  bool ends_with_empty_ = false;
  uint8_t control_in_bank_ = 0;
  bool control_toggle_ = true;
  uint8_t new_address_ = 0;
  bool awaits_line_coding_ = false;

  bool is_configured_ = false;
  bool is_asleep_ = false;
  uint16_t line_state_ = 0;
  uint8_t line_coding_[kLineCodingSize] = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8};  // 115200 8N1
  uint8_t bootloader_frames_ = 0;
  bool is_bootloader_due_ = false;

  OutBank out_[2] = {};
  uint8_t out_engine_bank_ = 0;  // the engine's next one
  uint8_t out_read_bank_ = 0;    // ours
  bool out_toggle_ = false;      // of the next one to be armed

  PacketQueue queue_;
  uint8_t in_engine_bank_ = 0;
  uint8_t in_flight_ = 0;
  bool in_toggle_ = false;
};

}  // namespace isorig::firmware
