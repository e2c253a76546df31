#pragma once
#include <cstdint>

#include "daemon/rig/virtual_rig.hpp"

namespace isorig::daemon::test {

/// What the simulated devices made while a run was recorded, by their own counters: a loss on the way to the recorder
/// changes nothing here.
class MadeSamples {
 public:
  /// After every tick of the rig. `open`: a recorder takes what comes.
  void look(VirtualRig& rig, bool open) noexcept {
    const auto now_ns = rig.now_ns();
    const bool recorded = open && now_ns < recorded_until_ns_;
    // As the core has it, and 7 s of a run that is over and not closed, as while the disk hangs.
    if (rig.core().loop_status().run_loaded || (recorded && rig.core().state() == RunState::kStopping))
      recorded_until_ns_ = now_ns + Core::kRecordedAfterNs;
    frame_.look(rig.rig().frame().sequence(), recorded);
    pressure_.look(rig.rig().pressure().sequence(), recorded);
  }
  [[nodiscard]] std::uint64_t frame() const noexcept { return frame_.made; }
  [[nodiscard]] std::uint64_t pressure() const noexcept { return pressure_.made; }

 private:
  struct Counter {
    std::uint32_t sequence = 0;
    std::uint64_t made = 0;

    void look(std::uint32_t now, bool recorded) noexcept {
      // A device that was restarted counts from 0.
      if (recorded) made += now >= sequence ? now - sequence : now;
      sequence = now;
    }
  };

  Counter frame_, pressure_;
  std::int64_t recorded_until_ns_ = 0;
};

}  // namespace isorig::daemon::test
