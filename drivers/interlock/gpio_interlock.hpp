#pragma once
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/api/interlock.hpp"
#include "drivers/interlock/contact.hpp"
#include "drivers/interlock/gpio_port.hpp"
#include "drivers/interlock/stamp_clock.hpp"

namespace isorig::interlock {

/// Emergency-stop chain, guard, vent valve and sync line on the GPIO lines of one chip (docs/gpio.md). Owned by one
/// I/O thread, which after a DeviceError calls disconnect() and, later, connect().
///
/// Fails safe: a contact counts as open from its first opening edge until it has been closed for `closing_ns`; one
/// that was over by then is told by its time (State::estop_opened_ns); edges that the kernel lost are made up for by
/// reading the level; the valve's line is requested de-energised, and what becomes of it when this process is gone is
/// the chip driver's to say.
class GpioInterlock final : public Device {
 public:
  struct Options {
    std::string chip;
    std::string consumer = "isorigd";
    GpioLine estop;
    std::optional<GpioLine> guard;       ///< without one the guard counts as closed
    std::optional<GpioLine> vent_valve;  ///< active: energised, the pressure is held
    std::optional<GpioLine> sync;
    std::int64_t closing_ns = 50'000'000;
  };

  GpioInterlock(Options options, const clock::Clock& clock, GpioOpener opener = open_gpio_port);

  void connect() override;
  void disconnect() noexcept override;
  State read() override;
  void hold_pressure(bool energise) override;
  bool wait(std::int64_t timeout_ns) override;
  std::size_t take_sync_edges(std::span<SyncLineEdge> out) override;
  [[nodiscard]] Counters counters() const noexcept override { return counters_; }

  [[nodiscard]] StampClock::Kind stamp_clock() const noexcept { return stamps_.kind(); }
  [[nodiscard]] const Contact& estop() const noexcept { return estop_; }

 private:
  GpioPort& port();
  void take(const GpioEdge& edge, std::int64_t now_ns);
  void follow_level(std::size_t input, Contact& contact);

  static constexpr std::size_t kEstop = 0;
  static constexpr std::size_t kMaxSyncEdges = 256;
  // A line that oscillates must not keep this thread for ever: what is left is taken the next time.
  static constexpr int kMaxReads = 16;

  Options options_;
  const clock::Clock& clock_;
  GpioOpener opener_;
  std::size_t guard_input_ = 0;  // 0: none
  std::size_t sync_input_ = 0;   // 0: none
  std::unique_ptr<GpioPort> port_;
  std::array<GpioEdge, 3 * kGpioQueue> edges_{};
  StampClock stamps_;
  Contact estop_;
  Contact guard_;
  std::vector<SyncLineEdge> sync_edges_;
  Counters counters_;
};

}  // namespace isorig::interlock
