#pragma once
#include <stdint.h>

/// The registers of the MK66FX1M0VMD18 that the firmware uses, and no others. Names and values are those of
/// the K66 Sub-Family Reference Manual (NXP K66P144M180SF5RMV2); each block names its chapter.
namespace isorig::firmware::k66 {

using Reg8 = volatile uint8_t;
using Reg16 = volatile uint16_t;
using Reg32 = volatile uint32_t;

template <class Reg>
inline Reg& at(uint32_t address) noexcept {
  return *reinterpret_cast<Reg*>(address);
}

// Chapter "System Integration Module (SIM)".
inline Reg32& sim_sopt2() noexcept {
  return at<Reg32>(0x4004'8004);
}
inline Reg32& sim_scgc4() noexcept {
  return at<Reg32>(0x4004'8034);
}
inline Reg32& sim_scgc5() noexcept {
  return at<Reg32>(0x4004'8038);
}
inline Reg32& sim_scgc6() noexcept {
  return at<Reg32>(0x4004'803C);
}
inline Reg32& sim_clkdiv1() noexcept {
  return at<Reg32>(0x4004'8044);
}
inline Reg32& sim_clkdiv2() noexcept {
  return at<Reg32>(0x4004'8048);
}
inline constexpr uint32_t kSopt2UsbFromDivider = 1U << 18U;
inline constexpr uint32_t kSopt2DividerFromIrc48M = 3U << 16U;
inline constexpr uint32_t kScgc4Usb = 1U << 18U;
inline constexpr uint32_t kScgc5PortC = 1U << 11U;
inline constexpr uint32_t kScgc5PortD = 1U << 12U;
inline constexpr uint32_t kScgc6Ftf = 1U << 0U;
inline constexpr uint32_t kScgc6Spi0 = 1U << 12U;
inline constexpr uint32_t kScgc6Ftm0 = 1U << 24U;

// Chapter "Oscillator (OSC)".
inline Reg8& osc_cr() noexcept {
  return at<Reg8>(0x4006'5000);
}
inline constexpr uint8_t kOscEnable = 0x80;
inline constexpr uint8_t kOscLoad2pF = 0x08;
inline constexpr uint8_t kOscLoad8pF = 0x02;

// Chapter "Multipurpose Clock Generator (MCG)".
inline Reg8& mcg_c1() noexcept {
  return at<Reg8>(0x4006'4000);
}
inline Reg8& mcg_c2() noexcept {
  return at<Reg8>(0x4006'4001);
}
inline Reg8& mcg_c5() noexcept {
  return at<Reg8>(0x4006'4004);
}
inline Reg8& mcg_c6() noexcept {
  return at<Reg8>(0x4006'4005);
}
inline Reg8& mcg_s() noexcept {
  return at<Reg8>(0x4006'4006);
}
inline constexpr uint8_t kC1PllOrFll = 0U << 6U;
inline constexpr uint8_t kC1External = 2U << 6U;
inline constexpr uint8_t kC1Divide512 = 4U << 3U;
inline constexpr uint8_t kC2HighRange = 2U << 4U;
inline constexpr uint8_t kC2Crystal = 1U << 2U;
inline constexpr uint8_t kC6Pll = 1U << 6U;
inline constexpr uint8_t kSCrystalReady = 0x02;
inline constexpr uint8_t kSClockMask = 0x0C;
inline constexpr uint8_t kSClockExternal = 0x08;
inline constexpr uint8_t kSClockPll = 0x0C;
inline constexpr uint8_t kSFllInternal = 0x10;
inline constexpr uint8_t kSPllSelected = 0x20;
inline constexpr uint8_t kSPllLocked = 0x40;

// Chapters "System Mode Controller (SMC)" and "Power Management Controller (PMC)".
inline Reg8& smc_pmprot() noexcept {
  return at<Reg8>(0x4007'E000);
}
inline Reg8& smc_pmctrl() noexcept {
  return at<Reg8>(0x4007'E001);
}
inline Reg8& smc_pmstat() noexcept {
  return at<Reg8>(0x4007'E003);
}
inline Reg8& pmc_regsc() noexcept {
  return at<Reg8>(0x4007'D002);
}
inline constexpr uint8_t kPmprotHighSpeedRun = 0x80;
inline constexpr uint8_t kPmctrlHighSpeedRun = 3U << 5U;
inline constexpr uint8_t kPmstatHighSpeedRun = 0x80;
inline constexpr uint8_t kRegscReleasePins = 0x08;

// Chapter "Watchdog Timer (WDOG)".
inline Reg16& wdog_stctrlh() noexcept {
  return at<Reg16>(0x4005'2000);
}
inline Reg16& wdog_tovalh() noexcept {
  return at<Reg16>(0x4005'2004);
}
inline Reg16& wdog_tovall() noexcept {
  return at<Reg16>(0x4005'2006);
}
inline Reg16& wdog_refresh() noexcept {
  return at<Reg16>(0x4005'200C);
}
inline Reg16& wdog_unlock() noexcept {
  return at<Reg16>(0x4005'200E);
}
inline Reg16& wdog_presc() noexcept {
  return at<Reg16>(0x4005'2016);
}
inline constexpr uint16_t kWdogEnable = 0x0001;
inline constexpr uint16_t kWdogAllowUpdate = 0x0010;
inline constexpr uint16_t kWdogReserved8 = 0x0100;  ///< reads and is kept as 1

// Chapter "Local Memory Controller (LMEM)".
inline Reg32& lmem_pcccr() noexcept {
  return at<Reg32>(0xE008'2000);
}
inline constexpr uint32_t kPcccrInvalidateAndEnable = 0x8500'0003;

// Chapter "Memory Protection Unit (MPU)": access of the bus masters in region 0, which is all of memory.
inline Reg32& mpu_rgdaac0() noexcept {
  return at<Reg32>(0x4000'D800);
}
inline constexpr uint32_t kMpuMaster4ReadWrite = 0x0300'0000;  ///< USBFS

// Chapter "Flash Memory Module (FTFE)".
inline Reg8& ftfe_fstat() noexcept {
  return at<Reg8>(0x4002'0000);
}
inline Reg32& ftfe_fccob3210() noexcept {
  return at<Reg32>(0x4002'0004);
}
inline Reg32& ftfe_fccobba98() noexcept {
  return at<Reg32>(0x4002'000C);
}
inline constexpr uint8_t kFstatIdle = 0x80;
inline constexpr uint8_t kFstatErrors = 0x70;

// Chapters "Port Control and Interrupts (PORT)" and "General-Purpose Input/Output (GPIO)".
struct Gpio {
  Reg32 output, set, clear, toggle, input, direction;
};
inline Gpio& gpio_c() noexcept {
  return at<Gpio>(0x400F'F080);
}
inline Gpio& gpio_d() noexcept {
  return at<Gpio>(0x400F'F0C0);
}
inline Reg32& port_c(uint32_t pin) noexcept {
  return at<Reg32>(0x4004'B000 + 4 * pin);
}
inline Reg32& port_d(uint32_t pin) noexcept {
  return at<Reg32>(0x4004'C000 + 4 * pin);
}
inline constexpr uint32_t kPcrMuxShift = 8;
inline constexpr uint32_t kPcrGpio = 1U << kPcrMuxShift;
inline constexpr uint32_t kPcrAlt2 = 2U << kPcrMuxShift;
inline constexpr uint32_t kPcrAlt4 = 4U << kPcrMuxShift;
inline constexpr uint32_t kPcrPullUp = 0x3;
inline constexpr uint32_t kPcrSlowSlew = 0x4;
inline constexpr uint32_t kPcrStrong = 0x40;

// Chapter "FlexTimer Module (FTM)".
struct Ftm {
  Reg32 sc, cnt, mod;
  struct Channel {
    Reg32 sc, value;
  } channels[8];
};
inline Ftm& ftm0() noexcept {
  return at<Ftm>(0x4003'8000);
}
inline constexpr uint32_t kFtmBusClock = 1U << 3U;
inline constexpr uint32_t kFtmDivide16 = 4;
inline constexpr uint32_t kFtmEdgeAlignedHighTrue = 0x28;

// Chapter "Serial Peripheral Interface (SPI)".
struct Spi {
  Reg32 mcr, reserved, tcr, ctar0, ctar1, reserved2[6], sr, rser, pushr, popr;
};
inline Spi& spi0() noexcept {
  return at<Spi>(0x4002'C000);
}
static_assert(__builtin_offsetof(Spi, sr) == 0x2C && __builtin_offsetof(Spi, popr) == 0x38);
inline constexpr uint32_t kMcrMaster = 1U << 31U;
inline constexpr uint32_t kMcrClearFifos = 3U << 10U;
inline constexpr uint32_t kMcrHalt = 1U;
inline constexpr uint32_t kSrReceived = 1U << 17U;
inline constexpr uint32_t kSrReceiveCount = 0xFU << 4U;
inline constexpr uint32_t kSrAllFlags = 0x9A0A'0000;
/// 16 bits, mode 0, MSB first; 60 MHz / 5 / 16 = 750 kHz, high and low 0.667 us each: the fastest that these
/// dividers give below the sensor's 800 kHz.
inline constexpr uint32_t kCtar16Bits750kHz = 15U << 27U | 2U << 16U | 4U;

// Chapter "Universal Serial Bus Full Speed OTG Controller (USBFSOTG)".
inline Reg8& usb(uint32_t offset) noexcept {
  return at<Reg8>(0x4007'2000 + offset);
}
enum UsbRegister : uint32_t {
  kUsbOtgIstat = 0x10,
  kUsbIstat = 0x80,
  kUsbInten = 0x84,
  kUsbErrstat = 0x88,
  kUsbStat = 0x90,
  kUsbCtl = 0x94,
  kUsbAddr = 0x98,
  kUsbBdtPage1 = 0x9C,
  kUsbBdtPage2 = 0xB0,
  kUsbBdtPage3 = 0xB4,
  kUsbEndpoint0 = 0xC0,  ///< each further one 4 on
  kUsbUsbctrl = 0x100,
  kUsbControl = 0x108,
  kUsbClkRecoverCtrl = 0x140,
  kUsbClkRecoverIrcEn = 0x144,
};
inline constexpr uint8_t kIstatReset = 0x01;
inline constexpr uint8_t kIstatError = 0x02;
inline constexpr uint8_t kIstatFrameStart = 0x04;
inline constexpr uint8_t kIstatToken = 0x08;
inline constexpr uint8_t kIstatSleep = 0x10;
inline constexpr uint8_t kIstatStall = 0x80;
inline constexpr uint8_t kIstatUsed =
    kIstatReset | kIstatError | kIstatFrameStart | kIstatToken | kIstatSleep | kIstatStall;
inline constexpr uint8_t kCtlEnable = 0x01;
inline constexpr uint8_t kCtlResetBanks = 0x02;
inline constexpr uint8_t kEndpointHandshake = 0x01;
inline constexpr uint8_t kEndpointStall = 0x02;
inline constexpr uint8_t kEndpointIn = 0x04;
inline constexpr uint8_t kEndpointOut = 0x08;
inline constexpr uint8_t kEndpointNoControl = 0x10;
inline constexpr uint8_t kControlPullUp = 0x10;

// ARM DDI 0403, C1.8: Data Watchpoint and Trace unit.
inline Reg32& demcr() noexcept {
  return at<Reg32>(0xE000'EDFC);
}
inline Reg32& dwt_ctrl() noexcept {
  return at<Reg32>(0xE000'1000);
}
inline Reg32& dwt_cyccnt() noexcept {
  return at<Reg32>(0xE000'1004);
}
inline constexpr uint32_t kDemcrTrace = 1U << 24U;
inline constexpr uint32_t kDwtCount = 1U;

}  // namespace isorig::firmware::k66
