#pragma once
#include "firmware/usb_sie.hpp"

namespace isorig::firmware::teensy36 {

/// The USBFS module, polled.
class UsbSieK66 final : public UsbSie {
 public:
  /// Clock, buffer table, pull-up: from here on the host sees a device.
  void start() noexcept;

  [[nodiscard]] bool take_token(Token& token) noexcept override;
  [[nodiscard]] bool take_reset() noexcept override;
  [[nodiscard]] bool take_frame_start() noexcept override;
  [[nodiscard]] bool take_sleep() noexcept override;
  void arm(uint8_t endpoint, bool is_in, uint8_t bank, uint8_t* buffer, uint16_t size, bool is_data1) noexcept override;
  void disarm(uint8_t endpoint, bool is_in, uint8_t bank) noexcept override;
  void set_endpoint(uint8_t endpoint, Endpoint kind) noexcept override;
  void set_address(uint8_t address) noexcept override;
  void stall_control() noexcept override;
  void resume_after_setup() noexcept override;
};

}  // namespace isorig::firmware::teensy36
