#include "firmware/teensy36/clocks.hpp"

#include "firmware/serial_text.hpp"
#include "firmware/teensy36/registers.hpp"

namespace isorig::firmware::teensy36 {

using namespace k66;

namespace {

char serial_text[kSerialTextSize];

// Chapter FTFE, "Read Once command": record 7 of the program once field; the number is its first four bytes.
// Not to be done in high speed run mode.
uint32_t read_factory_number() noexcept {
  constexpr uint32_t kReadOnce = 0x41U << 24U;
  constexpr uint32_t kRecord = 7U << 16U;
  sim_scgc6() |= kScgc6Ftf;
  while ((ftfe_fstat() & kFstatIdle) == 0) {
  }
  ftfe_fstat() = kFstatErrors;
  ftfe_fccob3210() = kReadOnce | kRecord;
  ftfe_fstat() = kFstatIdle;
  while ((ftfe_fstat() & kFstatIdle) == 0) {
  }
  return ftfe_fccobba98();
}

// Chapter MCG, "MCG mode switching": FEI, as after reset, to FBE, PBE and PEE.
void start_pll() noexcept {
  osc_cr() = kOscEnable | kOscLoad8pF | kOscLoad2pF;
  mcg_c2() = kC2HighRange | kC2Crystal;
  mcg_c1() = kC1External | kC1Divide512;
  while ((mcg_s() & kSCrystalReady) == 0) {
  }
  while ((mcg_s() & kSFllInternal) != 0) {
  }
  while ((mcg_s() & kSClockMask) != kSClockExternal) {
  }
  // Above 120 MHz only in high speed run mode (chapter SMC), which is entered while the clock is still slow.
  smc_pmctrl() = kPmctrlHighSpeedRun;
  while (smc_pmstat() != kPmstatHighSpeedRun) {
  }
  // 16 MHz / 2 * 45 / 2 = 180 MHz: PRDIV 1 divides by 2, VDIV 29 multiplies by 45, and the VCO is halved.
  mcg_c5() = 1;
  mcg_c6() = kC6Pll | 29;
  while ((mcg_s() & kSPllSelected) == 0) {
  }
  while ((mcg_s() & kSPllLocked) == 0) {
  }
  // Core 180, bus 180 / 3 = 60, FlexBus 180 / 3, flash 180 / 7 = 25.7 MHz.
  sim_clkdiv1() = 0U << 28U | 2U << 24U | 2U << 20U | 6U << 16U;
  mcg_c1() = kC1PllOrFll | kC1Divide512;
  while ((mcg_s() & kSClockMask) != kSClockPll) {
  }
}

}  // namespace

void start_clocks() noexcept {
  if ((pmc_regsc() & kRegscReleasePins) != 0) pmc_regsc() = pmc_regsc() | kRegscReleasePins;
  smc_pmprot() = kPmprotHighSpeedRun;
  lmem_pcccr() = kPcccrInvalidateAndEnable;
  write_serial(read_factory_number(), serial_text);
  start_pll();
  demcr() |= kDemcrTrace;
  dwt_cyccnt() = 0;
  dwt_ctrl() |= kDwtCount;
}

const char* serial_number() noexcept {
  return serial_text;
}

}  // namespace isorig::firmware::teensy36
