#pragma once
#include <stdint.h>

#include "firmware/cycle_clock.hpp"
#include "firmware/elvh_reader.hpp"
#include "firmware/hardware.hpp"
#include "messages/teensy/device.hpp"

namespace isorig::firmware {

/// The firmware without its machine: one loop that never waits. There are no interrupts: everything a pass
/// does is bounded, and everything it looks at is a flag or a counter of the hardware.
class Application final : private messages::teensy::Board {
 public:
  struct Options {
    uint32_t cycles_per_us = 180;
    const char* serial = "";
    const char* firmware = "";
  };

  Application(const Options& options, Hardware& hardware) noexcept;

  /// Vents; to be called as early as the coils can be driven.
  void start() noexcept;
  /// One pass.
  void step() noexcept;

  [[nodiscard]] messages::teensy::Status status() noexcept { return core_.status(); }
  [[nodiscard]] uint32_t longest_pass_cycles() const noexcept { return longest_pass_; }
  void forget_longest_pass() noexcept { longest_pass_ = 0; }

  /// The sync line changes at each half second of the device clock, up at whole seconds: often enough to
  /// follow a crystal that warms up, seldom enough for any GPIO queue of the host.
  static constexpr uint32_t kSyncHalfPeriod_us = 500'000;

 private:
  [[nodiscard]] uint64_t now_us() noexcept override { return clock_.us(now_cycles()); }
  [[nodiscard]] bool send(const uint8_t* bytes, size_t size) noexcept override { return hardware_.send(bytes, size); }
  void set_valves(uint16_t fill_permille, uint16_t vent_permille) noexcept override;
  [[nodiscard]] uint64_t now_cycles() noexcept { return clock_.advance(hardware_.cycle_counter()); }

  void serve_link() noexcept;
  void read_sensor() noexcept;
  void drive_sync() noexcept;
  void drive_led(uint64_t now_us) noexcept;

  Hardware& hardware_;
  CycleClock clock_;
  messages::teensy::DeviceCore core_;
  ElvhReader reader_;
  uint64_t next_sync_ = 0;
  bool is_sync_high_ = false;
  bool is_link_open_ = false;
  bool is_led_on_ = false;
  uint64_t last_pass_ = 0;
  uint32_t longest_pass_ = 0;
};

}  // namespace isorig::firmware
