#include "firmware/mps2/machine.hpp"

#include "firmware/cortex_m/startup.hpp"

namespace isorig::firmware::mps2 {
namespace {

struct SysTick {
  volatile uint32_t control, reload, value;
};
SysTick& systick() noexcept {
  return *reinterpret_cast<SysTick*>(0xE000E010);
}

constexpr uint32_t kTick_us = 10'000;
/// 50 ms, as on the Teensy.
constexpr uint32_t kLimit_ticks = 5;
volatile uint32_t ticks_since_fed;

}  // namespace

void exit_emulator(uint32_t code) noexcept {
  constexpr uint32_t kApplicationExit = 0x20026;
  const uint32_t block[2] = {kApplicationExit, code};
  register uint32_t operation asm("r0") = 0x20;
  register const uint32_t* argument asm("r1") = block;
  for (;;) asm volatile("bkpt 0xAB" : "+r"(operation) : "r"(argument) : "memory");
}

void start_watchdog() noexcept {
  systick().reload = kTick_us * kClock_MHz - 1;
  systick().value = 0;
  systick().control = 0x7;
}

void feed_watchdog() noexcept {
  ticks_since_fed = 0;
}

void tick() noexcept {
  const uint32_t ticks = ticks_since_fed + 1;
  ticks_since_fed = ticks;
  if (ticks >= kLimit_ticks) cortex_m::reset_system();
}

}  // namespace isorig::firmware::mps2
