#pragma once
#include <stddef.h>
#include <stdint.h>

/// The parts of QEMU's mps2-an386 that the emulated Teensy uses (Arm DAI 0386, CMSDK DDI 0479).
namespace isorig::firmware::mps2 {

inline constexpr uint32_t kClock_MHz = 25;

struct Uart {
  volatile uint32_t data, state, control, interrupt, divider;

  void enable() noexcept {
    divider = 16;
    control = 0x3;
  }
  /// False while the last byte still waits, which here means that whoever is behind the emulator does not
  /// read.
  bool put(uint8_t byte) noexcept {
    if ((state & 0x1U) != 0) return false;
    data = byte;
    return true;
  }
  bool get(uint8_t& byte) noexcept {
    if ((state & 0x2U) == 0) return false;
    byte = static_cast<uint8_t>(data);
    return true;
  }
};
inline Uart& link_uart() noexcept {
  return *reinterpret_cast<Uart*>(0x40004000);
}
inline Uart& test_uart() noexcept {
  return *reinterpret_cast<Uart*>(0x40005000);
}

struct Timer {
  volatile uint32_t control, value, reload, interrupt;

  void start() noexcept {
    reload = 0xFFFFFFFF;
    value = 0xFFFFFFFF;
    control = 0x1;
  }
  /// It counts down, at kClock_MHz.
  [[nodiscard]] uint32_t elapsed() const noexcept { return ~value; }
};
inline Timer& timer() noexcept {
  return *reinterpret_cast<Timer*>(0x40000000);
}

/// Exit codes of the emulator.
inline constexpr uint32_t kExitFault = 70;

/// Semihosting SYS_EXIT_EXTENDED (Arm IHI 0101): ends the emulator with this code.
[[noreturn]] void exit_emulator(uint32_t code) noexcept;

/// The SysTick handler: a watchdog, which the machine itself does not have.
void tick() noexcept;
void start_watchdog() noexcept;
void feed_watchdog() noexcept;

/// A ring of bytes on their way out: whole messages or none.
template <size_t kSize>
class OutputRing {
 public:
  bool push(const uint8_t* bytes, size_t size) noexcept {
    if (size > kSize - count_) return false;
    for (size_t i = 0; i < size; ++i) bytes_[(first_ + count_++) % kSize] = bytes[i];
    return true;
  }
  void drain(Uart& uart) noexcept {
    while (count_ > 0 && uart.put(bytes_[first_])) {
      first_ = (first_ + 1) % kSize;
      --count_;
    }
  }
  void clear() noexcept { count_ = 0; }

 private:
  uint8_t bytes_[kSize] = {};
  size_t first_ = 0;
  size_t count_ = 0;
};

}  // namespace isorig::firmware::mps2
