#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>

#include "daemon/core/core.hpp"
#include "daemon/core/streams.hpp"
#include "daemon/io/frame_service.hpp"
#include "daemon/io/interlock_service.hpp"
#include "daemon/io/pressure_service.hpp"
#include "daemon/rig/config.hpp"
#include "drivers/api/clock.hpp"
#include "sim/rig.hpp"

namespace isorig::daemon {

/// A simulated rig with the daemon's core and services on it, ticked by hand: virtual time, one thread, a fixed order
/// within each millisecond. What `isorig run` and the tests stand on.
class VirtualRig {
 public:
  static constexpr std::int64_t kTickNs = 1'000'000;
  static constexpr std::int64_t kPressureTurnNs = 2'000'000;  ///< the pace of a Teensy's packets
  static constexpr std::int64_t kInterlockTurnNs = 5'000'000;

  /// Of each stream: more than comes between two looks of whoever drains them.
  static constexpr std::size_t kQueued = std::size_t{1} << 14U;

  /// `config.sim` has to be set; it has to outlive this.
  explicit VirtualRig(const RigConfig& config, std::size_t queued = kQueued)
      : VirtualRig(config, std::make_unique<sim::Rig>(*config.sim), 0, queued) {}
  /// Another daemon on the plant of one that is gone, and on the same clock: killed, or shut down. Nothing is told to
  /// the devices in between. `gone` is not ticked any more.
  VirtualRig(const RigConfig& config, VirtualRig&& gone)
      : VirtualRig(config, std::move(gone.rig_), gone.now_ns_, kQueued) {}

  /// One millisecond: plant, device threads' turns, then the core.
  void tick() {
    now_ns_ += kTickNs;
    clock_.sleep_until_ns(now_ns_);
    rig_->advance(now_ns_);
    if (hang_all) return;
    if (now_ns_ % kInterlockTurnNs == 0) interlock_.run_once(now_ns_);
    if (now_ns_ % poll_ns_ == 0) frame_.run_once(now_ns_);
    if (now_ns_ % kPressureTurnNs == 0) pressure_.run_once(now_ns_, 0);
    if (before_core) before_core(*this);
    if (hang_core) return;
    if (around_core) {
      around_core(core_, now_ns_);
    } else {
      core_.tick(now_ns_, 0, 0);
    }
  }

  /// The way out: frame stopped, vented. False when the crosshead was not seen to stand.
  bool shut_down() noexcept {
    frame_.leave();
    for (const auto until_ns = now_ns_ + FrameService::kLeaveNs; !frame_.stands() && now_ns_ < until_ns;) tick();
    const bool stood = frame_.shut_down();
    pressure_.shut_down();
    interlock_.shut_down();
    return stood;
  }

  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }
  [[nodiscard]] sim::Rig& rig() noexcept { return *rig_; }
  [[nodiscard]] Core& core() noexcept { return core_; }
  /// What the loop wants of the valves at this moment.
  [[nodiscard]] pressure::Command pressure_command() const noexcept { return pressure_link_.get_command(); }

  Streams streams;                                              ///< whoever ticks has to drain them
  std::function<void(VirtualRig&)> before_core;                 ///< when set, once a tick
  std::function<void(Core&, std::int64_t now_ns)> around_core;  ///< when set, ticks the core in our place
  bool hang_core = false;                                       ///< the loop does not come back; the services go on
  bool hang_all = false;                                        ///< nothing of the daemon comes back (SIGSTOP)

 private:
  VirtualRig(const RigConfig& config, std::unique_ptr<sim::Rig> plant, std::int64_t now_ns, std::size_t queued)
      : streams(queued),
        now_ns_(now_ns),
        rig_(std::move(plant)),
        core_(config.core, frame_link_, pressure_link_, interlock_link_, streams, nullptr),
        frame_(rig_->frame(), frame_link_, config.services, clock_),
        pressure_(rig_->pressure(), pressure_link_, interlock_link_, config.services, clock_),
        interlock_(rig_->interlock(), interlock_link_),
        poll_ns_(config.services.poll_period_ns) {
    clock_.sleep_until_ns(now_ns_);
  }

  std::int64_t now_ns_;
  clock::VirtualClock clock_;
  std::unique_ptr<sim::Rig> rig_;
  FrameLink frame_link_;
  PressureLink pressure_link_;
  InterlockLink interlock_link_;
  Core core_;
  FrameService frame_;
  PressureService pressure_;
  InterlockService interlock_;
  std::int64_t poll_ns_;
};

}  // namespace isorig::daemon
