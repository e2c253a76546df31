#include "firmware/cortex_m/startup.hpp"

#include "firmware/teensy36/board.hpp"
#include "firmware/teensy36/clocks.hpp"
#include "firmware/teensy36/registers.hpp"

using namespace isorig::firmware;

extern "C" [[noreturn]] void reset_handler() {
  // Within 256 bus cycles of reset, or the watchdog's settings are closed (chapter WDOG, "Watchdog
  // configuration time"): two words within 20 cycles of each other, then its control word.
  k66::wdog_unlock() = 0xC520;
  k66::wdog_unlock() = 0xD928;
  asm volatile("nop\n\tnop");
  k66::wdog_stctrlh() = k66::kWdogReserved8 | k66::kWdogAllowUpdate;

  cortex_m::enable_fpu();
  cortex_m::initialise_memory();
  teensy36::start_clocks();
  main();
  cortex_m::reset_system();
}

namespace {

/// Without current the muscle is vented: first that, then a new start.
[[noreturn]] void fault() {
  teensy36::release_coils();
  cortex_m::reset_system();
}

}  // namespace

using Vector = void (*)();
constexpr int kInterrupts = 100;
struct VectorTable {
  uint32_t* stack;
  Vector handlers[15 + kInterrupts];
};

// No interrupt is ever enabled; one that comes all the same is a fault.
#define ISORIG_FAULTS_10 fault, fault, fault, fault, fault, fault, fault, fault, fault, fault
extern const VectorTable vectors;
__attribute__((section(".vectors"), used)) const VectorTable vectors = {_stack_top,
                                                                        {reset_handler,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         fault,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10,
                                                                         ISORIG_FAULTS_10}};
#undef ISORIG_FAULTS_10

// Chapter FTFE, "Flash configuration field description", read by the chip at reset. A wrong FSEC locks the
// chip for good: 0xDE is not secured, mass erase enabled, no backdoor key; it is what every Teensy program
// has there. FOPT 0xF9: no EzPort, no NMI pin, fast start. tests/firmware/image_test.cpp reads both back from
// the image.
struct FlashConfig {
  uint8_t backdoor_key[8];
  uint8_t program_protection[4];
  uint8_t security;
  uint8_t options;
  uint8_t eeprom_protection;
  uint8_t data_protection;
};
static_assert(sizeof(FlashConfig) == 16);
extern const FlashConfig flash_config;
__attribute__((section(".flash_config"), used)) const FlashConfig flash_config = {
    {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}, {0xFF, 0xFF, 0xFF, 0xFF}, 0xDE, 0xF9, 0xFF, 0xFF};
