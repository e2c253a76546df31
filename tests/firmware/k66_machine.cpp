#include "k66_machine.hpp"

#include <stdexcept>

namespace isorig::firmware {
namespace {

constexpr std::uint32_t kFlashSize = 1U << 20U;
constexpr std::uint32_t kRam = 0x2000'0000;
constexpr std::uint32_t kRamSize = 192U << 10U;
constexpr std::uint32_t kGpioC = 0x400F'F080;
constexpr std::uint32_t kGpioD = 0x400F'F0C0;
constexpr std::uint32_t kUsb = 0x4007'2000;
constexpr std::uint32_t kWdog = 0x4005'2000;
constexpr std::uint32_t kSpi = 0x4002'C000;
constexpr unsigned kSelectBit = 4;

std::string hex_text(std::uint32_t value) {
  char text[16];
  std::snprintf(text, sizeof text, "%08x", value);
  return text;
}

void must(uc_err error, const char* what) {
  if (error != UC_ERR_OK) throw std::runtime_error(std::string(what) + ": " + uc_strerror(error));
}

}  // namespace

K66Machine::K66Machine(const Memory& hex, std::uint32_t pass_address) : pass_address_(pass_address & ~1U) {
  must(uc_open(UC_ARCH_ARM, static_cast<uc_mode>(UC_MODE_THUMB | UC_MODE_MCLASS), &uc_), "uc_open");
  must(uc_ctl_set_cpu_model(uc_, UC_CPU_ARM_CORTEX_M4), "model");
  must(uc_mem_map(uc_, 0, kFlashSize, UC_PROT_READ | UC_PROT_EXEC), "flash");
  // SRAM_L, below, is not there: the image is not to use it.
  must(uc_mem_map(uc_, kRam, kRamSize, UC_PROT_READ | UC_PROT_WRITE), "ram");
  std::vector<std::uint8_t> flash(kFlashSize, 0xFF);
  for (const auto& [address, value] : hex) flash.at(address) = value;
  must(uc_mem_write(uc_, 0, flash.data(), flash.size()), "image");
  // What RAM holds after power-up is nobody's business: anything but zeros.
  const std::vector<std::uint8_t> junk(kRamSize, 0xA5);
  must(uc_mem_write(uc_, kRam, junk.data(), junk.size()), "ram");

  const auto reader = [](uc_engine*, std::uint64_t offset, unsigned size, void* self) -> std::uint64_t {
    return static_cast<K66Machine*>(self)->read(kPeripherals + static_cast<std::uint32_t>(offset), size);
  };
  const auto writer = [](uc_engine*, std::uint64_t offset, unsigned size, std::uint64_t value, void* self) {
    static_cast<K66Machine*>(self)->write(kPeripherals + static_cast<std::uint32_t>(offset), size,
                                          static_cast<std::uint32_t>(value));
  };
  const auto private_reader = [](uc_engine*, std::uint64_t offset, unsigned size, void* self) -> std::uint64_t {
    return static_cast<K66Machine*>(self)->read(kPrivate + static_cast<std::uint32_t>(offset), size);
  };
  const auto private_writer = [](uc_engine*, std::uint64_t offset, unsigned size, std::uint64_t value, void* self) {
    static_cast<K66Machine*>(self)->write(kPrivate + static_cast<std::uint32_t>(offset), size,
                                          static_cast<std::uint32_t>(value));
  };
  must(uc_mmio_map(uc_, kPeripherals, 1U << 20U, reader, this, writer, this), "peripherals");
  must(uc_mmio_map(uc_, kPrivate, 1U << 20U, private_reader, this, private_writer, this), "private bus");
  uc_hook hook = 0;
  must(uc_hook_add(uc_, &hook, UC_HOOK_CODE, reinterpret_cast<void*>(on_code), this, 1, 0), "hook");
  must(uc_hook_add(uc_, &hook, UC_HOOK_INTR, reinterpret_cast<void*>(on_exception), this, 1, 0), "hook");
  must(uc_hook_add(uc_, &hook, UC_HOOK_MEM_INVALID, reinterpret_cast<void*>(on_bad_memory), this, 1, 0), "hook");

  store(0x4004'8044, 4, 0x0001'0000);  // CLKDIV1: flash at half
  store(kWdog, 2, 0x01D3);
  gpio_[0] = 0;
  usb.read_memory = [this](std::uint32_t address) {
    std::uint32_t word = 0;
    must(uc_mem_read(uc_, address, &word, 4), "USB reads memory");
    return word;
  };
  usb.write_memory = [this](std::uint32_t address, std::uint32_t word) {
    must(uc_mem_write(uc_, address, &word, 4), "USB writes memory");
  };
  usb.run_us = [this](std::uint64_t us) { run_us(us); };

  const std::uint32_t stack = word_at(hex, 0);
  const std::uint32_t pc = word_at(hex, 4);
  must(uc_reg_write(uc_, UC_ARM_REG_SP, &stack), "sp");
  must(uc_reg_write(uc_, UC_ARM_REG_PC, &pc), "pc");
}

void K66Machine::run_us(std::uint64_t us) {
  if (stopped != Stop::kRunning) return;
  until_cycles_ = cycles() + us * kCyclesPerUs;
  std::uint32_t pc = 0;
  must(uc_reg_read(uc_, UC_ARM_REG_PC, &pc), "pc");
  const uc_err error = uc_emu_start(uc_, pc | 1U, 0xFFFF'FFF0, 0, 0);
  if (error != UC_ERR_OK && stopped == Stop::kRunning) {
    stopped = Stop::kFault;
    must(uc_reg_read(uc_, UC_ARM_REG_PC, &pc), "pc");
    fault += std::string(uc_strerror(error)) + " at " + hex_text(pc);
  }
}

void K66Machine::on_code(uc_engine* uc, std::uint64_t address, std::uint32_t, void* self) {
  auto& machine = *static_cast<K66Machine*>(self);
  ++machine.instructions_;
  if (address == machine.pass_address_) {  // Application::step() begins
    const std::uint64_t pass = machine.cycles() - machine.pass_cycles_;
    if (machine.passes++ > 0 && pass > machine.longest_pass_cycles) machine.longest_pass_cycles = pass;
    machine.pass_cycles_ = machine.cycles();
  }
  if (machine.cycles() >= machine.until_cycles_) uc_emu_stop(uc);
}

void K66Machine::on_exception(uc_engine* uc, std::uint32_t number, void* self) {
  auto& machine = *static_cast<K66Machine*>(self);
  constexpr std::uint32_t kBreakpoint = 7;
  machine.stopped = number == kBreakpoint ? Stop::kBreakpoint : Stop::kFault;
  machine.fault = "exception " + std::to_string(number);
  uc_emu_stop(uc);
}

bool K66Machine::on_bad_memory(uc_engine*, uc_mem_type, std::uint64_t address, int, std::int64_t, void* self) {
  static_cast<K66Machine*>(self)->fault = "no memory at " + hex_text(static_cast<std::uint32_t>(address)) + ": ";
  return false;
}

std::uint8_t K66Machine::byte(std::uint32_t address) const {
  const auto found = registers_.find(address);
  return found == registers_.end() ? 0 : found->second;
}

void K66Machine::store(std::uint32_t address, unsigned size, std::uint32_t value) {
  for (unsigned i = 0; i < size; ++i) registers_[address + i] = static_cast<std::uint8_t>(value >> 8 * i);
}

std::uint32_t K66Machine::reg(std::uint32_t address) const {
  std::uint32_t value = 0;
  for (unsigned i = 0; i < 4; ++i) value |= static_cast<std::uint32_t>(byte(address + i)) << 8 * i;
  return value;
}

std::uint32_t K66Machine::read(std::uint32_t address, unsigned size) {
  if (address >= kUsb && address < kUsb + 0x200) {
    return usb.read(address - kUsb);
  }
  switch (address) {
    case 0x4006'4006:
      return clock_status();
    case 0x4007'E003:
      return (byte(0x4007'E001) >> 5 & 3) == 3 && (byte(0x4007'E000) & 0x80) != 0 ? 0x80 : 0x01;
    case 0x4002'0000:
      return 0x80;  // FSTAT: a command is done at once
    case 0xE000'1004:
      return static_cast<std::uint32_t>(cycles());
    case kGpioC:
      return gpio_[0];
    case kGpioD:
      return gpio_[1];
    case kSpi + 0x2C: {
      const bool is_done = is_word_under_way_ && now_ns() - word_ns_ >= 21'333;
      return 0x4200'0000U | (is_done ? 1U << 17U : 0U);
    }
    case kSpi + 0x38:
      is_word_under_way_ = false;
      return sensor.shift_word();
    default:
      break;
  }
  const std::uint32_t value = reg(address);
  return size == 4 ? value : value & ((1U << 8 * size) - 1);
}

void K66Machine::write(std::uint32_t address, unsigned size, std::uint32_t value) {
  if (address >= kUsb && address < kUsb + 0x200) return usb.write(address - kUsb, static_cast<std::uint8_t>(value));
  if (address >= kWdog && address < kWdog + 0x18) return write_watchdog(address, value);
  if ((address & ~0x1FU) == kGpioC || (address & ~0x1FU) == kGpioD) return write_gpio(address, value);
  store(address, size, value);
  switch (address) {
    case 0x4002'0000:
      if ((value & 0x80U) != 0) start_flash_command();
      break;
    case 0x4006'4000:
      check_clocks();
      break;
    case kSpi + 0x34:
      start_word();
      break;
    case 0xE000'ED0C:
      stopped = Stop::kReset;
      uc_emu_stop(uc_);
      break;
    default:
      break;
  }
}

std::uint8_t K66Machine::clock_status() {
  const std::uint8_t c1 = byte(0x4006'4000);
  const std::uint8_t c6 = byte(0x4006'4005);
  std::uint8_t status = 0;
  if ((byte(0x4006'4001) & 0x04) != 0) status |= 0x02;          // the crystal runs
  if ((c1 & 0xC0) == 0 && (c1 & 0x38) == 0) status |= 0x10;     // FEI
  if ((c6 & 0x40) != 0) status |= 0x60;                         // PLL selected and locked
  if ((c1 & 0xC0) == 0x80) status |= 0x08;                      // external
  if ((c1 & 0xC0) == 0x00 && (c6 & 0x40) != 0) status |= 0x0C;  // PLL
  return status;
}

// K66 data sheet, "Device clock specifications": in high speed run mode core 180, bus 60, flash 28 MHz at
// most.
void K66Machine::check_clocks() {
  const std::uint8_t c1 = byte(0x4006'4000);
  const std::uint8_t c6 = byte(0x4006'4005);
  if ((c1 & 0xC0) != 0 || (c6 & 0x40) == 0) return;
  const unsigned divider = (byte(0x4006'4004) & 0x07U) + 1;
  const unsigned multiplier = (c6 & 0x1FU) + 16;
  const std::uint64_t pll_Hz = 16'000'000ULL / divider * multiplier / 2;
  const std::uint32_t dividers = reg(0x4004'8044);
  core_Hz = pll_Hz / ((dividers >> 28 & 15) + 1);
  if (16'000'000 / divider < 8'000'000 || 16'000'000 / divider > 16'000'000) violate("PLL reference");
  if (core_Hz > 120'000'000 && read(0x4007'E003, 1) != 0x80) violate("fast without high speed run mode");
  if (core_Hz > 180'000'000) violate("core clock");
  if (pll_Hz / ((dividers >> 24 & 15) + 1) > 60'000'000) violate("bus clock");
  if (pll_Hz / ((dividers >> 16 & 15) + 1) > 28'000'000) violate("flash clock");
}

void K66Machine::write_gpio(std::uint32_t address, std::uint32_t value) {
  const unsigned port = (address & ~0x1FU) == kGpioC ? 0 : 1;
  const std::uint32_t gate = port == 0 ? 1U << 11U : 1U << 12U;
  if ((reg(0x4004'8038) & gate) == 0) violate("port without a clock");
  const std::uint32_t before = gpio_[port];
  switch (address & 0x1FU) {
    case 0x00:
      gpio_[port] = value;
      break;
    case 0x04:
      gpio_[port] |= value;
      break;
    case 0x08:
      gpio_[port] &= ~value;
      break;
    case 0x0C:
      gpio_[port] ^= value;
      break;
    default:
      store(address, 4, value);
      return;
  }
  if (port == 0 && ((before ^ gpio_[0]) >> kSelectBit & 1U) != 0) {
    if ((gpio_[0] >> kSelectBit & 1U) == 0) {
      if (now_ns() - deselected_ns_ < 2'000) violate("sensor selected again within 2 us");
      selected_ns_ = now_ns();
      sensor.select(now_ns());
      ++sensor_reads;
    } else {
      deselected_ns_ = now_ns();
    }
  }
}

void K66Machine::start_word() {
  const std::uint32_t mcr = reg(kSpi);
  const std::uint32_t ctar = reg(kSpi + 0x0C);
  if ((mcr & 0x8000'0000U) == 0 || (mcr & 0x4001U) != 0) violate("SPI is not a running master");
  if ((ctar >> 27 & 15) != 15) violate("not 16 bits a word");
  if ((ctar >> 25 & 3) != 0) violate("not mode 0");
  constexpr unsigned kPrescalers[] = {2, 3, 5, 7};
  constexpr unsigned kScalers[] = {2, 4, 6, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
  const double rate_Hz = 60e6 / (kPrescalers[ctar >> 16 & 3] * kScalers[ctar & 15]) * ((ctar >> 31) + 1);
  if (rate_Hz > 800e3 || rate_Hz < 50e3) violate("SPI clock");
  if ((reg(0x4004'B01C) >> 8 & 7) != 2 || (reg(0x4004'C004) >> 8 & 7) != 2) violate("SPI pins");
  if ((gpio_[0] >> kSelectBit & 1U) != 0) violate("sensor not selected");
  if (now_ns() - selected_ns_ < 2'500) violate("clock within 2.5 us of select");
  if (is_word_under_way_) violate("a word before the last one was taken");
  is_word_under_way_ = true;
  word_ns_ = now_ns();
}

// FCCOB is big-endian within its words: FCCOB0 is at offset 7.
void K66Machine::start_flash_command() {
  if (read(0x4007'E003, 1) == 0x80) violate("flash command in high speed run mode");
  if (byte(0x4002'0007) != 0x41 || byte(0x4002'0006) != 7) violate("not the read of record 7");
  store(0x4002'000C, 4, kFactoryNumber);
}

void K66Machine::write_watchdog(std::uint32_t address, std::uint32_t value) {
  constexpr std::uint64_t kTwentyBusCycles = 60;
  constexpr std::uint64_t kWindow = 256ULL * 3;
  switch (address - kWdog) {
    case 0x0E:
      // After reset the bus is as fast as the core, and the window closes for good after 256 of its cycles.
      if (unlock_cycles_ == 0 && cycles() > 256) violate("watchdog unlocked too late after reset");
      if (value == 0xD928 && cycles() - unlock_cycles_ > kTwentyBusCycles) violate("slow unlock");
      unlock_cycles_ = cycles();
      return;
    case 0x0C: {
      if (value == 0xB480) {
        if (cycles() - refresh_cycles_ > kTwentyBusCycles) violate("slow refresh");
        if (cycles() - unlock_cycles_ < 3'000 * kCyclesPerUs) violate("refresh before the settings took effect");
        const std::uint64_t unfed = cycles() - fed_cycles_;
        if (fed_cycles_ != 0 && unfed > longest_unfed_cycles) longest_unfed_cycles = unfed;
        fed_cycles_ = cycles();
        ++feeds;
      }
      refresh_cycles_ = cycles();
      return;
    }
    default:
      if (cycles() - unlock_cycles_ > kWindow) violate("watchdog setting outside its window");
      store(address, 2, value);
      if (address == kWdog) {
        is_watchdog_on = (value & 1U) != 0;
        if ((value & 2U) != 0) violate("watchdog not on its own oscillator");
        if ((value & 0x20U) != 0) violate("watchdog runs while the boot loader holds the core");
        if ((value & 0x10U) == 0) violate("watchdog could not be stopped for the boot loader");
        const std::uint32_t prescaler = (byte(kWdog + 0x17) & 7U) + 1;
        watchdog_ms =
            (static_cast<std::uint32_t>(byte(kWdog + 5)) << 24 | static_cast<std::uint32_t>(byte(kWdog + 4)) << 16 |
             static_cast<std::uint32_t>(byte(kWdog + 7)) << 8 | byte(kWdog + 6)) *
            prescaler;
      }
  }
}

int K66Machine::coil_permille(unsigned bit, unsigned channel) const {
  if ((reg(kGpioC + 0x14) >> bit & 1U) == 0) return -1;  // not driven
  const unsigned function = reg(0x4004'B000 + 4 * bit) >> 8 & 7;
  if (function == 1) return (gpio_[0] >> bit & 1U) != 0 ? 1000 : 0;
  if (function != 4) return -1;
  const std::uint32_t period = reg(0x4003'8008) + 1;
  const std::uint32_t status = reg(0x4003'8000);
  const std::uint32_t kind = reg(0x4003'800C + 8 * channel);
  if ((status >> 3 & 3) != 1 || kind != 0x28) return -1;
  return static_cast<int>(1000ULL * reg(0x4003'8010 + 8 * channel) / period);
}

}  // namespace isorig::firmware
