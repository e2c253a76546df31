#include "firmware/application.hpp"
#include "firmware/teensy36/board.hpp"
#include "firmware/teensy36/clocks.hpp"

int main() {
  using namespace isorig::firmware;
  static teensy36::Board board;
  board.start();
  static Application application(
      {.cycles_per_us = teensy36::kCore_MHz, .serial = teensy36::serial_number(), .firmware = ISORIG_VERSION}, board);
  application.start();
  for (;;) {
    board.run();
    application.step();
  }
}
