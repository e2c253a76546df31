#pragma once
#include <stdint.h>

namespace isorig::firmware {

/// The serial interface engine of a full-speed USB device controller with two buffers ("banks") for each
/// endpoint and direction, used in turn: what UsbDevice needs of the USBFS module of a Kinetis
/// (K66P144M180SF5RMV2, chapter "Universal Serial Bus Full Speed OTG Controller (USBFSOTG)").
class UsbSie {
 public:
  enum class Pid : uint8_t { kOut = 0x1, kIn = 0x9, kSetup = 0xD };

  /// A transaction that was completed, in the order they happened. The engine goes on to the other bank of
  /// this endpoint and direction.
  struct Token {
    uint8_t endpoint = 0;
    bool is_in = false;
    uint8_t bank = 0;
    Pid pid = Pid::kOut;
    uint16_t size = 0;
  };

  enum class Endpoint : uint8_t { kOff, kControl, kIn, kOut };

  [[nodiscard]] virtual bool take_token(Token& token) noexcept = 0;
  /// True once after each bus reset. Tokens from before it are gone, all banks start at 0, the address is 0.
  [[nodiscard]] virtual bool take_reset() noexcept = 0;
  /// True when a frame started (each millisecond) since the last call.
  [[nodiscard]] virtual bool take_frame_start() noexcept = 0;
  /// True once the bus has been idle for 3 ms.
  [[nodiscard]] virtual bool take_sleep() noexcept = 0;

  /// Hands a buffer to the engine: IN sends `size` bytes of it, OUT takes up to `size`. `is_data1` is the
  /// toggle sent or expected; a SETUP is always taken.
  virtual void arm(uint8_t endpoint, bool is_in, uint8_t bank, uint8_t* buffer, uint16_t size,
                   bool is_data1) noexcept = 0;
  virtual void disarm(uint8_t endpoint, bool is_in, uint8_t bank) noexcept = 0;
  virtual void set_endpoint(uint8_t endpoint, Endpoint kind) noexcept = 0;
  virtual void set_address(uint8_t address) noexcept = 0;
  /// Answers STALL until the next SETUP.
  virtual void stall_control() noexcept = 0;
  /// After a SETUP the engine takes nothing until it has been dealt with.
  virtual void resume_after_setup() noexcept = 0;

 protected:
  ~UsbSie() = default;
};

}  // namespace isorig::firmware
