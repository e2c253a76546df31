#pragma once
#include <atomic>
#include <bit>
#include <cstdint>

#include "base/spsc_queue.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/api/interlock.hpp"
#include "drivers/api/pressure.hpp"
#include "drivers/api/regulator.hpp"
#include "drivers/clock_map/sync_check.hpp"

/// What crosses between the real-time loop and the threads that own a device. Each link has one I/O thread on
/// one side and the loop on the other; nothing in it blocks.
namespace isorig::daemon {

/// A device sample with its place on the one clock.
template <typename Sample>
struct Stamped {
  Sample sample;
  std::int64_t mono_ns = 0;
  float bound_ns = 0.0F;
  float repeatability_ns = 0.0F;
};

/// How a device is doing, from its I/O thread, each time something changed and at least every 100 ms.
struct LinkHealth {
  bool connected = false;
  bool clock_ready = false;      ///< enough exchanges for a mapping with a bound
  std::uint32_t lost = 0;        ///< samples, since start
  std::uint32_t corrupt = 0;     ///< messages, since start
  std::uint32_t errors = 0;      ///< failed calls, since start
  std::uint32_t reconnects = 0;  ///< since start
  float bound_ns = 0.0F;         ///< of the newest stamp
  float repeatability_ns = 0.0F;
  float sample_rate_hz = 0.0F;  ///< as the device says
  std::uint32_t clock_epoch =
      0;  ///< epochs of the device's clock, since start: a new one each time it was set or restarted
  std::uint32_t clock_rejected = 0;  ///< time exchanges that were wrong, since start
  std::int64_t failed_ns = 0;        ///< when the last call failed; 0: none has
  char detail[224] = {};             ///< the last error, for people
  char identity[96] = {};            ///< maker, model, serial number, firmware, as the device says
};

/// The clock mapping measured by the sync line, each time something changed.
struct SyncReport {
  std::int64_t mono_ns = 0;  ///< when it was decided
  bool has_check = false;
  clock::SyncCheck check;
  clock::SyncCounts counts;
};

/// What the frame says of itself, and what its service has seen of it.
struct FrameReport {
  frame::State state;
  std::int64_t mono_ns = 0;           ///< when the state was read
  std::uint32_t stop_request = 0;     ///< the newest stop request that the service has taken up ...
  bool stop_confirmed = false;        ///< ... and whether it has ended in standstill
  bool stands = false;                ///< the report says no motion, and the samples' slope is no more than their noise
  float velocity_mm_s = 0.0F;         ///< that slope, as the frame counts
  float velocity_bound_mm_s = 0.0F;   ///< what the noise explains
  float position_mm = 0.0F;           ///< mean over the window of the slope, as the frame counts
  std::uint32_t reference_epoch = 0;  ///< frame::Identity's of this connection
  std::uint32_t reconnects = 0;       ///< LinkHealth's; each connection begins with a stop
  std::uint32_t taken_segment =
      0;  ///< FrameCommand::number of the last that the frame took in this connection; 0: none
  std::uint32_t refused_segment = 0;  ///< ... and of the last that it did not take; LinkHealth::detail says why
};

struct FrameCommand {
  frame::Segment segment;
  std::uint32_t number = 0;      ///< the loop's own count from 1, which no frame can echo from before a restart
  std::uint32_t after_stop = 0;  ///< the stop request it comes after; one that is older has been overtaken
};

struct FrameLink {
  base::SpscQueue<Stamped<frame::Sample>> samples{8192};
  base::SpscQueue<FrameReport> reports{1024};
  base::SpscQueue<LinkHealth> health{64};
  base::SpscQueue<clock::Exchange> exchanges{1024};
  base::SpscQueue<FrameCommand> commands{64};
  /// Counts the loop's requests to stop. A request is a state, not a message: the service repeats the stop until
  /// it has seen the frame stand, sends no segment and withholds the heartbeat until then.
  std::atomic<std::uint32_t> stops_requested{0};
  /// The loop's tick counter: the I/O thread writes it to the frame as the heartbeat, so that a loop that
  /// hangs stops the frame even while the I/O thread lives.
  std::atomic<std::uint32_t> loop_beat{0};
};

/// What a pressure regulator says of itself.
struct RegulatorReport {
  pressure::RegulatorState state;
  std::int64_t mono_ns = 0;
};

struct PressureLink {
  base::SpscQueue<Stamped<pressure::Sample>> samples{8192};
  base::SpscQueue<LinkHealth> health{64};
  base::SpscQueue<clock::Exchange> exchanges{1024};
  base::SpscQueue<pressure::State> states{256};
  base::SpscQueue<SyncReport> sync{64};
  /// Of the regulator's I/O thread, where there is one; it takes its set-point from `command`, as the Teensy's does.
  base::SpscQueue<RegulatorReport> regulator_reports{64};
  base::SpscQueue<LinkHealth> regulator_health{64};
  /// To the device, when a calibration is put in force.
  base::SpscQueue<pressure::FillLimits> limits{8};
  /// The newest command only: an old duty is of no use. fill | vent << 16 | bits of the regulator's set-point << 32.
  std::atomic<std::uint64_t> command{0};
  std::atomic<std::uint32_t> loop_beat{0};

  void set_command(const pressure::Command& c) noexcept {
    command.store(std::uint64_t{c.fill_permille} | std::uint64_t{c.vent_permille} << 16 |
                      std::uint64_t{std::bit_cast<std::uint32_t>(c.regulator_psi)} << 32,
                  std::memory_order_release);
  }
  [[nodiscard]] pressure::Command get_command() const noexcept {
    const auto packed = command.load(std::memory_order_acquire);
    return {static_cast<std::uint16_t>(packed), static_cast<std::uint16_t>(packed >> 16),
            std::bit_cast<float>(static_cast<std::uint32_t>(packed >> 32))};
  }
};

struct InterlockLink {
  /// mono_ns of the reading with its three lowest bits replaced: bit 0 e-stop chain whole, bit 1 guard closed,
  /// bit 2 the inputs cannot be read.
  std::atomic<std::int64_t> state{0};
  std::atomic<std::int64_t> estop_opened_ns{0}, guard_opened_ns{0};
  base::SpscQueue<interlock::SyncLineEdge> sync_edges{256};  ///< to the thread that owns the pressure device
  base::SpscQueue<LinkHealth> health{64};
  std::atomic<bool> hold_pressure{false};
  std::atomic<std::uint32_t> loop_beat{0};

  void set_state(const interlock::State& s) noexcept {
    estop_opened_ns.store(s.estop_opened_ns, std::memory_order_relaxed);
    guard_opened_ns.store(s.guard_opened_ns, std::memory_order_relaxed);
    state.store((s.mono_ns & ~kBits) | (s.estop_closed ? 1 : 0) | (s.guard_closed ? 2 : 0) | (s.lost ? 4 : 0),
                std::memory_order_release);
  }
  [[nodiscard]] interlock::State get_state() const noexcept {
    const auto packed = state.load(std::memory_order_acquire);
    return {.estop_closed = (packed & 1) != 0,
            .guard_closed = (packed & 2) != 0,
            .mono_ns = packed & ~kBits,
            .estop_opened_ns = estop_opened_ns.load(std::memory_order_relaxed),
            .guard_opened_ns = guard_opened_ns.load(std::memory_order_relaxed),
            .lost = (packed & 4) != 0};
  }

 private:
  static constexpr std::int64_t kBits = 7;
};

}  // namespace isorig::daemon
