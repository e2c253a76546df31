#pragma once
#include <stdint.h>

/// What both boards do between reset and main(). The symbols come from the linker scripts.
extern "C" {
extern uint32_t _data_load[], _data_start[], _data_end[];
extern uint32_t _bss_start[], _bss_end[];
extern uint32_t _stack_limit[], _stack_top[];
extern void (*const _init_array_start[])();
extern void (*const _init_array_end[])();
int main();
}

namespace isorig::firmware::cortex_m {

/// ARM DDI 0403 (ARMv7-M Architecture Reference Manual), B3.2.
inline volatile uint32_t& aircr() noexcept {
  return *reinterpret_cast<volatile uint32_t*>(0xE000ED0C);
}
inline volatile uint32_t& cpacr() noexcept {
  return *reinterpret_cast<volatile uint32_t*>(0xE000ED88);
}

[[noreturn]] inline void reset_system() noexcept {
  constexpr uint32_t kKey = 0x05FAU << 16U;
  constexpr uint32_t kSystemReset = 1U << 2U;
  asm volatile("dsb" ::: "memory");
  aircr() = kKey | kSystemReset;
  for (;;) asm volatile("dsb" ::: "memory");
}

/// The compiler may keep integers in FPU registers: full access before anything else runs.
inline void enable_fpu() noexcept {
  cpacr() |= 0xFU << 20U;
  asm volatile("dsb\n\tisb" ::: "memory");
}

inline constexpr uint32_t kStackPaint = 0x57AC57AC;

/// Copies .data, clears .bss, paints the stack below the caller's frame, runs the constructors.
inline void initialise_memory() noexcept {
  const uint32_t* from = _data_load;
  for (uint32_t* to = _data_start; to != _data_end; ++to) *to = *from++;
  for (uint32_t* to = _bss_start; to != _bss_end; ++to) *to = 0;
  uint32_t* here = nullptr;
  asm volatile("mov %0, sp" : "=r"(here));
  for (uint32_t* to = _stack_limit; to < here - 32; ++to) *to = kStackPaint;
  for (auto init = _init_array_start; init != _init_array_end; ++init) (*init)();
}

/// The most that the stack has held since the start, in bytes.
inline uint32_t stack_high_water() noexcept {
  const uint32_t* at = _stack_limit;
  while (at != _stack_top && *at == kStackPaint) ++at;
  return static_cast<uint32_t>(reinterpret_cast<uintptr_t>(_stack_top) - reinterpret_cast<uintptr_t>(at));
}

}  // namespace isorig::firmware::cortex_m
