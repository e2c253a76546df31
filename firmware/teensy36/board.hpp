#pragma once
#include "firmware/hardware.hpp"
#include "firmware/teensy36/usb_sie_k66.hpp"
#include "firmware/usb_device.hpp"

namespace isorig::firmware::teensy36 {

/// Both coils off, by plain pin writes: usable in a fault handler, before and without everything else.
void release_coils() noexcept;

/// The Teensy 3.6. Pins are in docs/firmware.md.
class Board final : public Hardware {
 public:
  Board() noexcept;

  void start() noexcept;
  /// What is to be done in each pass beside the application's own work.
  void run() noexcept;

  void select(bool is_selected) noexcept override;
  void start_word() noexcept override;
  [[nodiscard]] bool take_word(uint16_t& word) noexcept override;

  [[nodiscard]] uint32_t cycle_counter() noexcept override;
  [[nodiscard]] bool is_link_open() noexcept override { return usb_.is_open(); }
  [[nodiscard]] size_t receive(uint8_t* out, size_t size) noexcept override { return usb_.receive(out, size); }
  [[nodiscard]] bool send(const uint8_t* bytes, size_t size) noexcept override { return usb_.send(bytes, size); }
  void discard_output() noexcept override { usb_.discard_output(); }

  void drive_coils(uint16_t fill_permille, uint16_t vent_closing_permille) noexcept override;
  void set_sync(bool is_high) noexcept override;
  void set_led(bool is_on) noexcept override;
  void feed_watchdog() noexcept override;

 private:
  UsbSieK66 sie_;
  UsbDevice usb_;
  uint32_t fed_ = 0;
};

}  // namespace isorig::firmware::teensy36
