#pragma once
// The Teensy's very image on an emulated Cortex-M4 core (Unicorn) with the registers of the MK66FX1M0 that it
// uses, modelled after the reference manual: what is written where, in what order, and what comes back. It
// shows that the board layer does what its author thinks the manual says; only hardware shows that the manual
// was read rightly.
#include <unicorn/unicorn.h>

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "firmware/model/simulated_elvh.hpp"
#include "image_file.hpp"
#include "k66_usb.hpp"

namespace isorig::firmware {

class K66Machine {
 public:
  static constexpr std::uint32_t kFactoryNumber = 123'456;
  static constexpr std::uint64_t kCyclesPerUs = 180;

  /// `pass_address`: of the function that each pass of the main loop begins with.
  K66Machine(const Memory& hex, std::uint32_t pass_address);
  ~K66Machine() { uc_close(uc_); }
  K66Machine(const K66Machine&) = delete;
  K66Machine& operator=(const K66Machine&) = delete;

  /// Runs until that long has passed, or the program stopped: at a breakpoint, a fault, a reset.
  void run_us(std::uint64_t us);
  void run_ms(std::uint64_t ms) { run_us(1'000 * ms); }
  [[nodiscard]] std::uint64_t cycles() const { return instructions_ * 5 / 4; }
  [[nodiscard]] std::uint64_t now_ns() const { return cycles() * 1'000 / kCyclesPerUs; }

  enum class Stop { kRunning, kBreakpoint, kReset, kFault };
  Stop stopped = Stop::kRunning;
  std::string fault;

  /// What the manual forbids and the program did.
  std::vector<std::string> violations;

  SimulatedElvh sensor;
  K66Usb usb;

  [[nodiscard]] std::uint32_t reg(std::uint32_t address) const;
  /// Level of a pin of port C or D that is a driven output; PWM counts as its duty in permille.
  [[nodiscard]] int coil_permille(unsigned bit, unsigned channel) const;
  [[nodiscard]] bool pin_d(unsigned bit) const { return (gpio_[1] >> bit & 1U) != 0; }

  std::uint64_t core_Hz = 20'971'520;
  bool is_watchdog_on = false;
  std::uint32_t watchdog_ms = 0;
  std::uint64_t longest_unfed_cycles = 0;
  int feeds = 0;
  std::uint64_t longest_pass_cycles = 0;
  std::uint64_t passes = 0;
  int sensor_reads = 0;

 private:
  static constexpr std::uint32_t kPeripherals = 0x4000'0000;
  static constexpr std::uint32_t kPrivate = 0xE000'0000;

  static void on_code(uc_engine*, std::uint64_t, std::uint32_t, void* self);
  static void on_exception(uc_engine*, std::uint32_t number, void* self);
  static bool on_bad_memory(uc_engine*, uc_mem_type, std::uint64_t address, int, std::int64_t, void* self);

  std::uint32_t read(std::uint32_t address, unsigned size);
  void write(std::uint32_t address, unsigned size, std::uint32_t value);
  void store(std::uint32_t address, unsigned size, std::uint32_t value);
  [[nodiscard]] std::uint8_t byte(std::uint32_t address) const;
  std::uint8_t clock_status();
  void check_clocks();
  void write_gpio(std::uint32_t address, std::uint32_t value);
  void write_watchdog(std::uint32_t address, std::uint32_t value);
  void start_flash_command();
  void start_word();
  void violate(const std::string& what) { violations.push_back(what); }

  uc_engine* uc_ = nullptr;
  std::uint32_t pass_address_;
  std::uint64_t instructions_ = 0;
  std::uint64_t until_cycles_ = 0;
  std::map<std::uint32_t, std::uint8_t> registers_;
  std::array<std::uint32_t, 2> gpio_{};  // outputs of ports C and D
  std::uint64_t selected_ns_ = 0;
  std::uint64_t deselected_ns_ = 0;
  std::uint64_t word_ns_ = 0;
  bool is_word_under_way_ = false;
  std::uint64_t unlock_cycles_ = 0;
  std::uint64_t refresh_cycles_ = 0;
  std::uint64_t fed_cycles_ = 0;
  std::uint64_t pass_cycles_ = 0;
};

}  // namespace isorig::firmware
