#pragma once
#include <stddef.h>
#include <stdint.h>

namespace isorig::firmware {

/// The bus of the pressure sensor: SPI mode 0, at most 800 kHz, receive only. A transfer is started and
/// looked at again later; nothing here waits.
class SensorBus {
 public:
  /// Drives SS: low when selected.
  virtual void select(bool is_selected) noexcept = 0;
  /// Clocks in the next 16 bits.
  virtual void start_word() noexcept = 0;
  /// The 16 bits, first bit highest; false while they are on their way.
  [[nodiscard]] virtual bool take_word(uint16_t& word) noexcept = 0;

 protected:
  ~SensorBus() = default;
};

/// All that the application knows of the machine it runs on. Nothing waits.
class Hardware : public SensorBus {
 public:
  /// Counts up at the rate of Application::Options::cycles_per_us, modulo 2^32.
  [[nodiscard]] virtual uint32_t cycle_counter() noexcept = 0;

  /// Whether a host has the port open (DTR).
  [[nodiscard]] virtual bool is_link_open() noexcept = 0;
  [[nodiscard]] virtual size_t receive(uint8_t* out, size_t size) noexcept = 0;
  /// All of it, to be sent at once, or nothing and false.
  [[nodiscard]] virtual bool send(const uint8_t* bytes, size_t size) noexcept = 0;
  /// Forgets what was given to send() and has not left yet.
  virtual void discard_output() noexcept = 0;

  /// Duties of the two coils, 0..1000. The fill valve is closed without current, the vent valve open: without
  /// power, in reset and with both at zero the muscle is vented.
  virtual void drive_coils(uint16_t fill_permille, uint16_t vent_closing_permille) noexcept = 0;
  virtual void set_sync(bool is_high) noexcept = 0;
  virtual void set_led(bool is_on) noexcept = 0;
  /// Resets the machine unless called again soon.
  virtual void feed_watchdog() noexcept = 0;

 protected:
  ~Hardware() = default;
};

}  // namespace isorig::firmware
