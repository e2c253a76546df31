#include "firmware/teensy36/board.hpp"

#include "firmware/teensy36/clocks.hpp"
#include "firmware/teensy36/registers.hpp"

namespace isorig::firmware::teensy36 {

using namespace k66;

namespace {

// Port and bit of each pin, and its Teensy number. PTC5 (13) is both the LED and the usual SPI clock: the
// clock is on PTD1 (14) instead.
constexpr uint32_t kSelectBit = 4;       // PTC4, 10
constexpr uint32_t kMisoBit = 7;         // PTC7, 12: SPI0_SIN
constexpr uint32_t kClockBit = 1;        // PTD1, 14: SPI0_SCK
constexpr uint32_t kSyncBit = 0;         // PTD0, 2
constexpr uint32_t kLedBit = 5;          // PTC5, 13
constexpr uint32_t kFillBit = 1;         // PTC1, 22: FTM0_CH0
constexpr uint32_t kVentClosingBit = 2;  // PTC2, 23: FTM0_CH1

constexpr uint32_t kFillChannel = 0;
constexpr uint32_t kVentClosingChannel = 1;

/// 100 Hz: a solenoid valve of 2 ms follows duties from 20 % to 80 %, and a period is the age that a command
/// of the 100 Hz pressure loop has anyway.
constexpr uint32_t kPwm_Hz = 100;
constexpr uint32_t kPwmCounts = kBus_MHz * 1'000'000 / 16 / kPwm_Hz;
static_assert(kPwmCounts == 37'500);

// Fully off and fully on are plain levels, which act at once: a vent never waits for a period to end.
void drive(uint32_t bit, uint32_t channel, uint16_t permille) noexcept {
  ftm0().channels[channel].value = permille * kPwmCounts / 1000;
  if (permille == 0) gpio_c().clear = 1U << bit;
  if (permille >= 1000) gpio_c().set = 1U << bit;
  port_c(bit) = permille == 0 || permille >= 1000 ? kPcrGpio : kPcrAlt4;
}

void start_pins() noexcept {
  release_coils();
  gpio_c().set = 1U << kSelectBit;
  gpio_c().clear = 1U << kLedBit;
  gpio_c().direction = gpio_c().direction | 1U << kSelectBit | 1U << kLedBit;
  port_c(kSelectBit) = kPcrGpio | kPcrSlowSlew;
  port_c(kLedBit) = kPcrGpio | kPcrSlowSlew;
  gpio_d().clear = 1U << kSyncBit;
  gpio_d().direction = gpio_d().direction | 1U << kSyncBit;
  port_d(kSyncBit) = kPcrGpio | kPcrStrong;
}

void start_sensor_bus() noexcept {
  sim_scgc6() |= kScgc6Spi0;
  // Without a sensor the line reads as all ones, which no sensor says.
  port_c(kMisoBit) = kPcrAlt2 | kPcrPullUp;
  port_d(kClockBit) = kPcrAlt2 | kPcrSlowSlew;
  spi0().mcr = kMcrMaster | kMcrClearFifos | kMcrHalt;
  spi0().ctar0 = kCtar16Bits750kHz;
  spi0().sr = kSrAllFlags;
  spi0().mcr = kMcrMaster;
}

void start_pwm() noexcept {
  sim_scgc6() |= kScgc6Ftm0;
  ftm0().sc = 0;
  ftm0().cnt = 0;
  ftm0().mod = kPwmCounts - 1;
  constexpr uint32_t kChannels[] = {kFillChannel, kVentClosingChannel};
  for (const uint32_t channel : kChannels) {
    ftm0().channels[channel].sc = kFtmEdgeAlignedHighTrue;
    ftm0().channels[channel].value = 0;
  }
  ftm0().sc = kFtmBusClock | kFtmDivide16;
}

// 50 ms of the 1 kHz low power oscillator, which does not depend on the crystal. It stands still while a
// debugger, and that is what the boot loader's chip is, holds the core.
constexpr uint16_t kWatchdog_ms = 50;
constexpr uint32_t kFeed_ms = 5;

void set_watchdog(bool is_on) noexcept {
  wdog_unlock() = 0xC520;
  wdog_unlock() = 0xD928;
  asm volatile("nop\n\tnop");
  wdog_presc() = 0;
  wdog_tovalh() = 0;
  wdog_tovall() = kWatchdog_ms;
  wdog_stctrlh() = static_cast<uint16_t>(kWdogReserved8 | kWdogAllowUpdate | (is_on ? kWdogEnable : 0));
}

// The boot loader is in a chip of its own, which watches the core's debug port for this instruction.
[[noreturn]] void enter_bootloader() noexcept {
  release_coils();
  set_watchdog(false);
  for (;;) asm volatile("bkpt 0");
}

}  // namespace

void release_coils() noexcept {
  sim_scgc5() |= kScgc5PortC | kScgc5PortD;
  gpio_c().clear = 1U << kFillBit | 1U << kVentClosingBit;
  gpio_c().direction = gpio_c().direction | 1U << kFillBit | 1U << kVentClosingBit;
  port_c(kFillBit) = kPcrGpio;
  port_c(kVentClosingBit) = kPcrGpio;
}

Board::Board() noexcept : usb_(sie_, serial_number()) {}

void Board::start() noexcept {
  start_pins();
  start_sensor_bus();
  start_pwm();
  sie_.start();
  set_watchdog(true);
  fed_ = cycle_counter();
}

void Board::run() noexcept {
  usb_.poll();
  if (usb_.wants_bootloader()) enter_bootloader();
}

void Board::select(bool is_selected) noexcept {
  if (is_selected) {
    gpio_c().clear = 1U << kSelectBit;
  } else {
    gpio_c().set = 1U << kSelectBit;
  }
}

void Board::start_word() noexcept {
  // A word that was given up would be taken for this one. The queue holds four.
  for (int i = 0; i < 4 && (spi0().sr & kSrReceiveCount) != 0; ++i) (void)spi0().popr;
  spi0().sr = kSrAllFlags;
  spi0().pushr = 0;
}

bool Board::take_word(uint16_t& word) noexcept {
  if ((spi0().sr & kSrReceived) == 0) return false;
  word = static_cast<uint16_t>(spi0().popr);
  return true;
}

uint32_t Board::cycle_counter() noexcept {
  return dwt_cyccnt();
}

void Board::drive_coils(uint16_t fill_permille, uint16_t vent_closing_permille) noexcept {
  drive(kFillBit, kFillChannel, fill_permille);
  drive(kVentClosingBit, kVentClosingChannel, vent_closing_permille);
}

void Board::set_sync(bool is_high) noexcept {
  if (is_high) {
    gpio_d().set = 1U << kSyncBit;
  } else {
    gpio_d().clear = 1U << kSyncBit;
  }
}

void Board::set_led(bool is_on) noexcept {
  if (is_on) {
    gpio_c().set = 1U << kLedBit;
  } else {
    gpio_c().clear = 1U << kLedBit;
  }
}

// Two words within 20 bus cycles: nothing interrupts here. Not in every pass, and not at once after the
// start: both cross over to the slow oscillator, and are to be left alone for three of its cycles (chapter
// WDOG, "Restrictions on watchdog operation").
void Board::feed_watchdog() noexcept {
  const uint32_t now = cycle_counter();
  if (now - fed_ < kFeed_ms * 1000 * kCore_MHz) return;
  fed_ = now;
  wdog_refresh() = 0xA602;
  wdog_refresh() = 0xB480;
}

}  // namespace isorig::firmware::teensy36
