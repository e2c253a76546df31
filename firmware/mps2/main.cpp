#include "firmware/application.hpp"
#include "firmware/cortex_m/startup.hpp"
#include "firmware/model/simulated_elvh.hpp"
#include "firmware/mps2/machine.hpp"

/// The Teensy's firmware on an emulated Cortex-M4: UART0 is the link, UART1 the line of the tests, the sensor is
/// simulated.
namespace isorig::firmware::mps2 {
namespace {

/// As much as a Teensy's USB queue holds in single frames; the emulator's own buffers come on top.
constexpr size_t kLinkBytes = 1024;

class Board final : public Hardware {
 public:
  void start() noexcept {
    timer().start();
    link_uart().enable();
    test_uart().enable();
    say("ready");
    start_watchdog();
  }
  /// What the hardware of a real board does by itself.
  void run(Application& application) noexcept {
    link_.drain(link_uart());
    test_line_.drain(test_uart());
    uint8_t command = 0;
    if (test_uart().get(command)) obey(command, application);
  }

  void select(bool is_selected) noexcept override {
    if (is_selected) sensor_.select(now_ns());
  }
  void start_word() noexcept override { word_ns_ = now_ns(); }
  bool take_word(uint16_t& word) noexcept override {
    if (now_ns() - word_ns_ < kWord_ns) return false;
    word = sensor_.shift_word();
    return true;
  }
  uint32_t cycle_counter() noexcept override { return timer().elapsed(); }
  bool is_link_open() noexcept override { return is_open_; }
  size_t receive(uint8_t* out, size_t size) noexcept override {
    size_t taken = 0;
    while (taken < size && link_uart().get(out[taken])) ++taken;
    return is_open_ ? taken : 0;
  }
  bool send(const uint8_t* bytes, size_t size) noexcept override { return link_.push(bytes, size); }
  void discard_output() noexcept override { link_.clear(); }
  void drive_coils(uint16_t fill_permille, uint16_t vent_closing_permille) noexcept override {
    sensor_.set_valves(now_ns(), fill_permille, static_cast<uint16_t>(1000 - vent_closing_permille));
    say("coils", fill_permille, vent_closing_permille);
  }
  void set_sync(bool is_high) noexcept override { say("sync", is_high ? 1 : 0); }
  void set_led(bool) noexcept override {}
  void feed_watchdog() noexcept override { mps2::feed_watchdog(); }

 private:
  static constexpr uint32_t kWord_ns = 21'333;  ///< 16 bits at 750 kHz

  uint64_t now_ns() noexcept { return clock_.advance(timer().elapsed()) * (1000 / kClock_MHz); }

  void obey(uint8_t command, Application& application) noexcept {
    using Fault = SimulatedElvh::Fault;
    switch (command) {
      case '+':
        is_open_ = true;
        break;
      case '-':
        is_open_ = false;
        break;
      case '0':
        sensor_.set_fault(Fault::kNone);
        break;
      case 'a':
        sensor_.set_fault(Fault::kAbsent);
        break;
      case 'l':
        sensor_.set_fault(Fault::kShorted);
        break;
      case 's':
        sensor_.set_fault(Fault::kSilent);
        break;
      case 'c':
        sensor_.set_fault(Fault::kStuckCurrent);
        break;
      case 'd':
        sensor_.set_fault(Fault::kDiagnostic);
        break;
      case 'p':
        say("pass", application.longest_pass_cycles());
        say("stack", cortex_m::stack_high_water());
        say("dropped", application.status().dropped);
        application.forget_longest_pass();
        break;
      case 'h':
        for (;;) asm volatile("" ::: "memory");
      case 'f':
        asm volatile("udf #0");
        break;
      case 'q':
        exit_emulator(0);
      default:
        break;
    }
  }

  void say(const char* what) noexcept {
    size_t size = 0;
    put(what, size);
    end(size);
  }
  template <class... Numbers>
  void say(const char* what, Numbers... numbers) noexcept {
    size_t size = 0;
    put(what, size);
    (put(static_cast<uint32_t>(numbers), size), ...);
    end(size);
  }
  void put(const char* text, size_t& size) noexcept {
    while (*text != '\0' && size + 1 < sizeof line_) line_[size++] = static_cast<uint8_t>(*text++);
  }
  void put(uint32_t number, size_t& size) noexcept {
    char digits[11];
    char* at = digits + sizeof digits - 1;
    *at = '\0';
    do {
      *--at = static_cast<char>('0' + number % 10);
      number /= 10;
    } while (number != 0);
    put(" ", size);
    put(at, size);
  }
  void end(size_t size) noexcept {
    line_[size] = '\n';
    (void)test_line_.push(line_, size + 1);
  }

  SimulatedElvh sensor_;
  CycleClock clock_{kClock_MHz};
  OutputRing<kLinkBytes> link_;
  OutputRing<4096> test_line_;
  uint8_t line_[64] = {};
  uint64_t word_ns_ = 0;
  bool is_open_ = true;
};

}  // namespace
}  // namespace isorig::firmware::mps2

int main() {
  using namespace isorig::firmware;
  static mps2::Board board;
  static Application application({.cycles_per_us = mps2::kClock_MHz, .serial = "QEMU0", .firmware = ISORIG_VERSION},
                                 board);
  board.start();
  application.start();
  for (;;) {
    application.step();
    board.run(application);
  }
}
