#include "sim/wire/gpio_lines.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <fstream>
#include <string_view>
#include <utility>

namespace isorig::sim {

GpioLines::GpioLines(Options options, WireRig& rig, const clock::Clock& clock)
    : options_(std::move(options)), rig_(rig), clock_(clock), edges_(clock.now_ns()) {}

void GpioLines::service() {
  std::int64_t due_ns = 0;
  bool rising = false;
  if (!options_.sync_pull.empty() && edges_.next(clock_.now_ns(), due_ns, rising)) {
    const int fd = ::open(options_.sync_pull.c_str(), O_WRONLY | O_CLOEXEC);
    const std::string_view level = rising ? "pull-up" : "pull-down";
    const std::int64_t before_ns = clock_.now_ns();
    (void)!::write(fd, level.data(), level.size());
    const std::int64_t after_ns = clock_.now_ns();
    // The edge lies between the two; a chip that is unplugged has none, and the Teensy raises its pin all the same.
    // When another process ran in between nobody knows where, and the device says nothing of that edge: a pin
    // stamps its own edge, this emulation must not state a time that it does not have.
    if (after_ns - before_ns <= kEdgeKnown_ns) rig_.sync_edge((before_ns + after_ns) / 2, rising);
    ::close(fd);
  }
  if (!options_.vent_value.empty() && clock_.now_ns() >= next_valve_ns_) {
    next_valve_ns_ = clock_.now_ns() + kValvePeriod_ns;
    char level = '0';
    std::ifstream(options_.vent_value) >> level;
    rig_.rig().interlock().hold_pressure(level == '1');
  }
}

}  // namespace isorig::sim
